"""`esfo benchmark`: numbers against known truth, as a table and as JSON, and one line for what cannot be measured."""

import json
from dataclasses import replace

import numpy as np
import pytest

from esfo_bringup.benchmark.orbit_accuracy import OrbitResult, TrackedScene, TrueScene, measure_orbit
from esfo_bringup.benchmark.orbit_table import row_of, summarise
from esfo_bringup.cli import main
from esfo_bringup.settings import settings_for
from esfo_core.camera import Camera
from esfo_core.estimate import OrbitEstimate
from esfo_core.orbit import Spin, angle_between, rotation
from esfo_core.recordings import write_mcap
from esfo_core.recordings.event_camera_dataset import write_event_camera_dataset
from esfo_frontend.warm_up import drifting_squares
from esfo_simulation.activity import synthetic_activity
from esfo_simulation.scene import SceneOptions
from esfo_simulation.scene_files import write_scene
from esfo_simulation.tracks import SyntheticTrackOptions, synthetic_tracks

CAMERA = Camera.pinhole(640, 480, 800.0)
AXIS = np.array([0.3, -0.8, 0.4]) / np.linalg.norm([0.3, -0.8, 0.4])


def printed(capsys, *arguments):
    assert main(["benchmark", *map(str, arguments)]) == 0
    return capsys.readouterr().out


def cells(line):
    return [cell.strip() for cell in line.strip("|").split("|")]


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """A folder with a spinning scene in a folder of its own, as sub-folders sort a data set."""
    folder = tmp_path_factory.mktemp("scenes")
    (folder / "fast").mkdir()
    options = SceneOptions(width=240, height=180, rate_hz=1.0, revolutions=2.3)
    write_scene(options, folder / "fast" / "hubble.mcap")
    return folder


def test_a_scene_is_measured_and_summarised(capsys, scenes):
    document = json.loads(printed(capsys, "topspin", scenes, "--json", "-p", "initialisation.method:=direct"))
    (scene,) = document["results"]
    assert (scene["scene"], scene["preset"], scene["status"]) == ("hubble", "default", "ok")
    assert scene["rate_error_percent"] < 0.02
    assert scene["axis_error_deg"] < 1.0
    assert scene["rate_error_over_std"] < 3
    assert scene["registration_percent"] < 2
    assert scene["colmap"] == "none"
    assert document["options"] == ["initialisation.method:=direct"]
    (summary,) = document["summary"]
    assert summary["statuses"] == {"ok": 1, "degenerate": 0, "failed": 0}
    assert summary["axis error, deg"]["median"] == scene["axis_error_deg"]
    assert document["versions"]["esfo"]


def test_the_table_has_a_row_per_scene_and_preset(capsys, scenes):
    lines = printed(
        capsys, "topspin", scenes, "--preset", "paper", "-p", "initialisation.colmap_min_tracks:=1000"
    ).splitlines()
    header, rule, row = lines[:3]
    assert len(cells(header)) == len(cells(rule)) == len(cells(row))
    assert cells(row)[:2] == ["hubble", "paper"]
    assert cells(row)[2].startswith("failed")
    assert "paper: 0 ok, 0 degenerate, 1 failed" in "\n".join(lines[3:])


def test_a_scene_without_its_surface_is_not_registered(capsys, scenes, tmp_path):
    for name in ("hubble.mcap", "hubble.truth.json"):
        (tmp_path / name).write_bytes((scenes / "fast" / name).read_bytes())
    out = json.loads(printed(capsys, "topspin", tmp_path, "--json", "-p", "initialisation.method:=direct"))
    assert out["results"][0]["registration_percent"] is None
    assert out["results"][0]["status"] == "ok"


@pytest.fixture(scope="module")
def measured():
    """Exact truth, noise of half a pixel, and a truth that says something else by known amounts."""
    spin = Spin(AXIS, 0.5, np.array([0.1, 0.05, 4.0]), 1_000_000_000)
    scene = synthetic_tracks(spin, CAMERA, SyntheticTrackOptions(noise_px=0.5))
    tracked = TrackedScene(scene.tracks, synthetic_activity(spin, scene.points, CAMERA, 4.0), 1.5)
    settings = settings_for("default", {"initialisation.method": "direct"})

    def against(truth):
        return measure_orbit(TrueScene("ball", None, CAMERA, truth, None), "default", settings, tracked)

    return spin, against


def test_errors_are_those_against_the_truth(measured):
    spin, against = measured
    right = against(spin)
    off = rotation(np.cross(AXIS, [1.0, 0, 0]) / np.linalg.norm(np.cross(AXIS, [1.0, 0, 0])), np.radians(5)) @ AXIS
    wrong = against(replace(spin, axis=off, rate_hz=0.55))
    assert right.z_rate < 3
    assert right.z_axis < 3.5
    assert right.axis_deg == pytest.approx(angle_between(right.estimate.spin.axis, AXIS))
    assert right.seconds[0] == 1.5
    assert wrong.axis_deg == pytest.approx(5, abs=0.3)
    assert wrong.rate_percent == pytest.approx(100 * 0.05 / 0.55, abs=0.01)
    assert wrong.z_rate == pytest.approx(0.05 / right.estimate.rate_std_hz, rel=1e-2)
    # A Mahalanobis distance lies between those that the least and the most certain direction would give.
    stds = np.degrees(np.sqrt(np.linalg.eigvalsh(right.estimate.axis_cov)))
    assert 4.7 / stds[1] < wrong.z_axis < 5.3 / stds[0]
    assert np.isnan(wrong.after).all()


def result(status="ok", rate=0.001, z=1.0, preset="default", seconds=(1.0, 2.0)):
    estimate = replace(OrbitEstimate.failure("why"), status=status)
    nowhere = (np.nan, np.nan)
    return OrbitResult("scene", preset, estimate, rate, 0.1, np.nan, z, 2 * z, "none", nowhere, nowhere, seconds)


def test_errors_are_summarised_of_what_is_called_ok():
    results = [
        result(rate=0.001),
        result(rate=0.004, z=2.0),
        result(rate=0.002),
        result("degenerate", rate=50.0, z=99.0, seconds=(7.0, 9.0)),
        result(preset="paper", rate=70.0),
    ]
    summary = summarise(results, "default")
    assert summary.statuses == {"ok": 3, "degenerate": 1, "failed": 0}
    assert summary.spread["rate error, %"] == (0.002, 0.004)
    assert summary.spread["screw line, px"] is None
    assert summary.spread["back-end, s"] == (2.0, 9.0)
    assert summary.covered == pytest.approx(5 / 6)  # of 1, 2, 2, 4, 1, 2
    assert "| screw line, px | - |  |" in summary.lines()
    assert json.dumps(summary.to_json(), allow_nan=False)
    assert json.dumps(result(rate=np.nan).to_json(), allow_nan=False)
    assert summarise([result("failed")], "default").covered is None
    assert row_of(results[3]).startswith("| scene | default | degenerate  why |")


class Slide:
    """A camera that moves so that what lies in the plane z = 1 moves by the squares' velocity in the image."""

    span = (0, 300_000_000)
    step = np.array([-150.0, -90.0, 0.0]) / 200.0

    def __init__(self, shake_px=0.0):
        self.shake = np.array([shake_px, 0, 0]) / 200.0

    def camera_poses(self, t):
        seconds = np.asarray(t, float)[:, None] / 1e9
        position = seconds * self.step + np.sin(2 * np.pi * seconds / 0.05) * self.shake
        return position, np.tile([0.0, 0, 0, 1], (len(t), 1))


def write_squares(folder, trajectory):
    camera = Camera.pinhole(240, 180, 200.0)
    write_event_camera_dataset(folder, [drifting_squares(duration_s=0.3)], trajectory, camera)


def test_tracks_are_set_against_true_poses(capsys, tmp_path):
    write_squares(tmp_path / "right", Slide())
    write_squares(tmp_path / "shaken", Slide(shake_px=6.0))
    write_squares(tmp_path / "unknown", Slide())
    (tmp_path / "unknown" / "groundtruth.txt").unlink()
    out = json.loads(printed(capsys, "event-camera-dataset", tmp_path, "--json"))
    right, shaken, unknown = out["results"]
    assert [r["scene"] for r in out["results"]] == ["right", "shaken", "unknown"]
    assert right["events"] == len(drifting_squares(duration_s=0.3))
    assert right["tracks"] == shaken["tracks"] == unknown["tracks"] > 10
    assert right["corners"] > 100
    at_3, *_ = right["accuracy"]
    assert [a["threshold_px"] for a in right["accuracy"]] == [3, 5, 7]
    assert at_3["tracks"] > 0.9 * right["tracks"]
    assert at_3["rmse_px"] < 1
    assert at_3["mean_age_s"] == pytest.approx(right["mean_age_s"], rel=0.1)
    assert 0.05 < right["median_age_s"] < 0.3
    assert unknown["accuracy"] == []
    # A sine of 6 px has a root mean square of 4.2 px, of which the fitted point takes some.
    at_3, at_5, _ = shaken["accuracy"]
    assert at_3 == {"threshold_px": 3, "tracks": 0, "rmse_px": None, "mean_age_s": None}
    assert at_5["tracks"] > 0.8 * shaken["tracks"]
    assert 3 < at_5["rmse_px"] < 4.3


def test_rows_without_a_pose_are_left_out_and_counted(capsys, tmp_path):
    write_squares(tmp_path, Slide())
    poses = (tmp_path / "groundtruth.txt").read_text().splitlines(keepends=True)
    (tmp_path / "groundtruth.txt").write_text("".join(poses[:40]))  # of 60
    (found,) = json.loads(printed(capsys, "event-camera-dataset", tmp_path, "--json"))["results"]
    assert found["rows_without_pose"] > 0
    assert found["accuracy"][0]["mean_age_s"] < found["mean_age_s"]


def test_the_table_of_tracks(capsys, tmp_path):
    write_squares(tmp_path / "squares", Slide())
    lines = printed(capsys, "event-camera-dataset", tmp_path, "--preset", "default", "--preset", "paper").splitlines()
    assert [cells(line)[:2] for line in lines[2:]] == [["squares", "default"], ["squares", "paper"]]
    assert {len(cells(line)) for line in lines} == {12}


def test_throughput(capsys, tmp_path):
    events = drifting_squares(duration_s=0.3)
    for name in ("a.mcap", "b.mcap"):
        write_mcap(tmp_path / name, [events], Camera.pinhole(160, 120, 200.0))
    lines = printed(capsys, "throughput", tmp_path / "a.mcap", tmp_path / "b.mcap").splitlines()
    assert [cells(line)[0] for line in lines[2:]] == [str(tmp_path / "a.mcap"), str(tmp_path / "b.mcap")]
    (found,) = json.loads(printed(capsys, "throughput", tmp_path / "a.mcap", "--json"))["results"]
    assert found["events"] == len(events)
    assert found["duration_s"] == pytest.approx((events["t"][-1] - events["t"][0]) / 1e9)
    assert found["read_mevs"] > found["front-end_mevs"] > 0
    assert found["corners_mevs"] > found["front-end_mevs"]  # the detector is a part of it


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("topspin", "."), "no recording with a .truth.json"),
        (("topspin", "orphan"), "although its truth is there"),
        (("topspin", "broken"), "not the truth of a scene"),
        (("event-camera-dataset", "."), "events.txt"),
        (("throughput", "nowhere.mcap"), "nowhere.mcap"),
        (("throughput", "x", "--preset", "paper", "--preset", "default"), "one preset"),
        (("topspin", ".", "-p", "frobnicate:=1"), "frobnicate"),
    ],
)
def test_what_cannot_be_measured_is_said_in_one_line(capsys, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    if "orphan" in arguments:
        (tmp_path / "orphan").mkdir()
        (tmp_path / "orphan" / "a.truth.json").write_text("{}")
    if "broken" in arguments:
        (tmp_path / "broken").mkdir()
        (tmp_path / "broken" / "a.truth.json").write_text("[]")
        (tmp_path / "broken" / "a.mcap").touch()
    assert main(["benchmark", *arguments]) == 1
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert said in lines[0]
