"""The command on bad input: one clear line and exit code 1, and no traceback."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from esfo_bringup.cli import main
from esfo_core.camera import Camera
from esfo_core.events import make_events
from esfo_core.recordings import write_mcap
from esfo_core.tracks import Tracks
from esfo_frontend.warm_up import HEIGHT, WIDTH, drifting_squares


def events(count, seed=0):
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, 2_000_000_000, count)) + 1_000_000_000
    return make_events(rng.integers(0, 64, count), rng.integers(0, 48, count), rng.integers(0, 2, count), t)


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "noise.mcap"
    write_mcap(path, [events(4000)], Camera.pinhole(64, 48, 80.0))
    return path


def fails(capsys, *arguments):
    """Run the command, which must fail; return its one line."""
    assert main([str(a) for a in arguments]) == 1
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1, lines
    assert lines[0].startswith("esfo: ")
    return lines[0]


def test_no_such_file(capsys, tmp_path):
    for command in ("info", "run", "live"):
        output = [] if command == "info" else ["-o", tmp_path / "out"]
        assert "nowhere.mcap" in fails(capsys, command, tmp_path / "nowhere.mcap", *output)


def test_empty_bag(capsys, tmp_path):
    empty = tmp_path / "empty.mcap"
    empty.touch()
    assert "empty.mcap" in fails(capsys, "run", empty, "-o", tmp_path / "out")


def test_bag_without_events(capsys, tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        writer.finish()
    assert "other.mcap" in fails(capsys, "run", path, "-o", tmp_path / "out")


def test_camera_of_another_size(capsys, tmp_path, recording):
    Camera.pinhole(640, 480, 500.0).write_yaml(tmp_path / "camera.yaml")
    for command in ("run", "live"):
        line = fails(capsys, command, recording, "--camera", tmp_path / "camera.yaml", "-o", tmp_path / "out")
        assert "640x480" in line
        assert "64x48" in line


def test_intrinsics_that_are_not_numbers(capsys, tmp_path, recording):
    Camera.pinhole(64, 48, 80.0).write_yaml(tmp_path / "camera.yaml")
    text = (tmp_path / "camera.yaml").read_text()
    (tmp_path / "camera.yaml").write_text(text.replace("80.0", ".nan"))
    assert ".nan" in (tmp_path / "camera.yaml").read_text()
    line = fails(capsys, "run", recording, "--camera", tmp_path / "camera.yaml", "-o", tmp_path / "out")
    assert "finite" in line


def test_unknown_option(capsys, tmp_path, recording):
    assert "frobnicate" in fails(capsys, "run", recording, "-p", "frobnicate:=3", "-o", tmp_path / "out")
    assert "name:=value" in fails(capsys, "run", recording, "-p", "join.radius=3", "-o", tmp_path / "out")
    assert "join.radius" in fails(capsys, "run", recording, "-p", "join.radius:=-3", "-o", tmp_path / "out")


def test_output_that_is_a_file(capsys, tmp_path, recording):
    (tmp_path / "out").touch()
    assert "not a folder" in fails(capsys, "run", recording, "-o", tmp_path / "out")


def test_noise_fails_with_a_reason_and_leaves_its_results(capsys, tmp_path, recording):
    line = fails(capsys, "run", recording, "-o", tmp_path / "out")
    assert "failed" in line
    orbit = json.loads((tmp_path / "out/orbit.json").read_text())
    assert orbit["status"] == "failed"
    assert orbit["spin_rate_hz"] is None
    assert orbit["reason"]
    assert not (tmp_path / "out/points.ply").exists()
    assert (tmp_path / "out/report.html").stat().st_size > 1000


def test_tracks_alone(capsys, tmp_path):
    path = tmp_path / "squares.mcap"
    write_mcap(path, [drifting_squares(duration_s=0.3)], Camera.pinhole(WIDTH, HEIGHT, 200.0))
    out = tmp_path / "out"
    assert main(["run", str(path), "--until", "tracks", "-o", str(out)]) == 0
    assert [p.name for p in out.iterdir()] == ["tracks.csv"]
    assert len(Tracks.read_csv(out / "tracks.csv")) > 20
    assert " tracks, " in capsys.readouterr().out


def test_guessed_intrinsics_are_named(capsys, tmp_path, recording, monkeypatch):
    from esfo_bringup.offline import source as offline

    opened = offline.open_recording(recording)
    opened.camera = None
    monkeypatch.setattr(offline, "open_recording", lambda *arguments: opened)
    fails(capsys, "run", recording, "-o", tmp_path / "out")
    assert "intrinsics_assumed" in json.loads((tmp_path / "out/orbit.json").read_text())["flags"]


def test_camera_file_tells_the_sensor_of_a_text(capsys, tmp_path):
    text = tmp_path / "events.txt"
    text.write_text("".join(f"{0.001 * k:.6f} {k % 40} {k % 30} {k % 2}\n" for k in range(2000)))
    camera = tmp_path / "camera.yaml"
    Camera.pinhole(64, 48, 80.0).write_yaml(camera)
    fails(capsys, "run", text, "--camera", camera, "-o", tmp_path / "out")
    assert "intrinsics_assumed" not in json.loads((tmp_path / "out/orbit.json").read_text())["flags"]
    assert "64x48 px" in (tmp_path / "out/report.html").read_text()
    fails(capsys, "run", text, "-p", "width:=50", "-p", "height:=40", "-o", tmp_path / "out")
    assert "50x40 px" in (tmp_path / "out/report.html").read_text()


def test_info(capsys, recording):
    assert main(["info", str(recording)]) == 0
    out = capsys.readouterr().out
    on = int(events(4000)["p"].sum())
    assert f"4000 ({on} on, {4000 - on} off)" in out
    assert "64x48" in out


def test_simulate_refuses_what_cannot_be(capsys, tmp_path):
    scene = tmp_path / "scene.mcap"
    assert "distance_m" in fails(capsys, "simulate", "-p", "distance_m:=0.3", "-o", scene)
    assert "revolutions" in fails(capsys, "simulate", "--revolutions", "-1", "-o", scene)
    assert ".mcap" in fails(capsys, "simulate", "-o", tmp_path / "scene.bag")
    assert not scene.exists()


def test_evaluate_wants_an_estimate_and_a_truth(capsys, tmp_path):
    (tmp_path / "orbit.json").write_text("{")
    (tmp_path / "truth.json").write_text("{}")
    assert "not a JSON file" in fails(capsys, "evaluate", tmp_path, "--truth", tmp_path / "truth.json")
    (tmp_path / "orbit.json").write_text('{"status": "failed"}')
    assert "failed" in fails(capsys, "evaluate", tmp_path, "--truth", tmp_path / "truth.json")
    assert "absent.json" in fails(capsys, "evaluate", tmp_path, "--truth", tmp_path / "absent.json")


def test_evaluate_holds_errors_against_limits(capsys, tmp_path):
    motion = {"spin_rate_hz": 0.5, "axis": [0, 0, 1.0], "center": [0.1, 0, 1.0]}
    truth = tmp_path / "truth.json"
    truth.write_text(json.dumps(motion))
    estimate = {"status": "ok", "points": 3, "initialisation": "direct", **motion, "spin_rate_hz": 0.51}
    (tmp_path / "orbit.json").write_text(json.dumps(estimate))
    assert main(["evaluate", str(tmp_path), "--truth", str(truth), "--max-rate-error", "3"]) == 0
    assert "2.0000 %" in capsys.readouterr().out
    assert "rate" in fails(capsys, "evaluate", tmp_path, "--truth", truth, "--max-rate-error", "1")


def test_evaluate_registers_to_a_model(capsys, tmp_path):
    motion = {"spin_rate_hz": 0.5, "axis": [0, 1.0, 0], "center": [0, 0, 4.0]}
    (tmp_path / "truth.json").write_text(json.dumps(motion))
    estimate = {"status": "ok", "points": 300, "initialisation": "direct", **motion, "center": [0, 0, 1.0]}
    (tmp_path / "orbit.json").write_text(json.dumps(estimate))
    box = trimesh.creation.box((1.0, 0.5, 0.7))
    box.export(tmp_path / "box.ply")
    points, _ = trimesh.sample.sample_surface(box, 300, seed=1)
    trimesh.PointCloud(points / 4).export(tmp_path / "points.ply")
    arguments = ["evaluate", tmp_path, "--truth", tmp_path / "truth.json", "--model"]
    assert main([str(a) for a in (*arguments, tmp_path / "box.ply")]) == 0
    percent = re.search(r"points are ([\d.]+) %", capsys.readouterr().out)
    assert float(percent[1]) < 0.05
    assert "not a Trimesh" in fails(capsys, *arguments, tmp_path / "points.ply")
    assert "absent.ply" in fails(capsys, *arguments, tmp_path / "absent.ply")


def test_a_degenerate_estimate_ends_with_its_reason_and_exit_code_1(capsys, tmp_path, recording, monkeypatch):
    from esfo_bringup.commands import run

    whole = run.run_offline

    def degenerate(*arguments):
        result = whole(*arguments)
        return replace(result, estimate=replace(result.estimate, status="degenerate", reason="seen for half a turn"))

    monkeypatch.setattr(run, "run_offline", degenerate)
    line = fails(capsys, "run", recording, "-o", tmp_path / "out")
    assert line == "esfo: degenerate: seen for half a turn"
    assert json.loads((tmp_path / "out/orbit.json").read_text())["status"] == "degenerate"


def test_evaluate_holds_the_axis_against_its_limit(capsys, tmp_path):
    motion = {"spin_rate_hz": 0.5, "axis": [0, 0, 1.0], "center": [0.1, 0, 1.0]}
    (tmp_path / "truth.json").write_text(json.dumps(motion))
    tilted = [0.0, float(np.sin(np.radians(2))), float(np.cos(np.radians(2)))]
    estimate = {"status": "ok", "points": 3, "initialisation": "direct", **motion, "axis": tilted}
    (tmp_path / "orbit.json").write_text(json.dumps(estimate))
    arguments = ["evaluate", str(tmp_path), "--truth", str(tmp_path / "truth.json"), "--max-axis-error"]
    assert main([*arguments, "2.1"]) == 0
    assert "2.000 deg" in capsys.readouterr().out
    assert "axis is 2.0000, more than 1.9" in fails(capsys, *arguments, "1.9")
