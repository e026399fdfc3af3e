"""`esfo simulate`: many scenes that go on where they stopped, a moving camera, and what cannot be."""

import json

import pytest

from esfo_bringup.cli import main
from esfo_bringup.commands import simulate
from esfo_core.recordings import open_recording
from esfo_core.recordings.event_camera_dataset import read_calib, read_groundtruth
from esfo_simulation.scene_files import topspin
from esfo_simulation.sensor.catalogue import SENSORS

SMALL = ["-p", "width:=96", "-p", "height:=72", "-p", "rate_hz:=5.0", "--revolutions", "0.1"]


def run(*arguments):
    return main(["simulate", *(str(a) for a in arguments)])


def test_many_scenes_go_on_where_they_stopped(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(simulate, "topspin", lambda base: dict(list(topspin(base).items())[:3]))
    assert run("--topspin", *SMALL, "-o", tmp_path) == 0
    recordings = sorted(tmp_path.glob("*.mcap"))
    assert [path.stem for path in recordings] == [f"hubble-topdown-{speed}" for speed in ("fast", "med", "slow")]
    before = [path.stat().st_mtime_ns for path in recordings]
    capsys.readouterr()

    recordings[1].with_suffix(".truth.json").unlink()  # as if it had been stopped here
    assert run("--topspin", *SMALL, "-o", tmp_path) == 0
    written = [path.stat().st_mtime_ns for path in recordings]
    assert [now > then for now, then in zip(written, before, strict=True)] == [False, True, False]
    assert "3 scenes" in capsys.readouterr().out

    assert run("--topspin", *SMALL, "-p", "seed:=2", "-o", tmp_path) == 0  # other options are other scenes
    assert all(path.stat().st_mtime_ns > then for path, then in zip(recordings, written, strict=True))


def test_a_moving_camera(tmp_path):
    assert run("--handheld", "shapes", "-p", "duration_s:=0.3", "-o", tmp_path) == 0
    text, bag = (open_recording(tmp_path / name) for name in ("events.txt", "events.mcap"))
    counts = [sum(len(chunk) for chunk in recording.chunks()) for recording in (text, bag)]
    assert counts[0] == counts[1] > 100
    poses = read_groundtruth(tmp_path / "groundtruth.txt")
    assert len(poses.t) == 61
    assert read_calib(tmp_path / "calib.txt").width == bag.width == 240


def test_a_sensor_by_name(tmp_path):
    path = tmp_path / "scene.mcap"
    assert run("--sensor", "davis346", "--lens", "8", "--revolutions", "0.02", "-o", path) == 0
    recording = open_recording(path)
    assert (recording.width, recording.height) == (346, 260)
    assert recording.camera.focal_px == pytest.approx(8000 / 18.5)
    truth = json.loads((tmp_path / "scene.truth.json").read_text())
    assert truth["options"]["sensor.threshold_off"] == SENSORS["davis346"].options.threshold_off


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--lens", "8", "-o", "s.mcap"], "--lens needs a --sensor"),
        (["--handheld", "shapes", "--view", "sideon"], "--view cannot be used with --handheld"),
        (["-p", "distance_m:=0.1", "-o", "s.mcap"], "the object reaches the camera"),
        (["-p", "distance_m:=0.4", "-o", "s.mcap"], "the object leaves the view"),
        (["--mesh", "none.ply", "-o", "s.mcap"], "none.ply"),
        (["-p", "max_events:=100", *SMALL, "-o", "s.mcap"], "more than 100 events"),
        (["-p", "sensor.flicker_hz:=-1", "-o", "s.mcap"], "sensor.flicker_hz is -1.0, below 0.0"),
    ],
)
def test_what_cannot_be_is_one_line(arguments, says, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert run("-o", "folder", *arguments) == 1
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert says in lines[0]
    assert not list(tmp_path.glob("*.mcap"))
