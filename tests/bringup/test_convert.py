"""`esfo convert` and `esfo info`: every written form holds the same events, and what is left out is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from esfo_bringup.cli import main
from esfo_bringup.commands.info import EventTiming
from esfo_core.camera import Camera
from esfo_core.codecs import encoder
from esfo_core.events import make_events
from esfo_core.recordings import open_recording, write_mcap

CAMERA = Camera.pinhole(64, 48, 80.0)
DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
OFFSET = 1_700_000_000 * 10**9


def some_events(count=4000, step=1000):
    """Events of 2 s from 1 s on, with a gap of 0.5 s after 2 s; times are multiples of `step` ns."""
    rng = np.random.default_rng(1)
    t = np.sort(rng.integers(10**9, 3 * 10**9, count))
    t = (t + (t > 2 * 10**9) * (5 * 10**8)) // step * step
    return make_events(rng.integers(0, 64, count), rng.integers(0, 48, count), rng.integers(0, 2, count), t)


def all_of(path):
    recording = open_recording(path)
    return recording, np.concatenate(list(recording.chunks()))


def fails(capsys, *arguments):
    """Run the command, which must fail; return its one line."""
    assert main([str(a) for a in arguments]) == 1
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1, lines
    return lines[0]


def facts(capsys, *arguments):
    """Run the command; return what it prints by the name in front."""
    assert main([str(a) for a in arguments]) == 0
    return {line[:12].strip(): line[12:] for line in capsys.readouterr().out.splitlines()}


@pytest.fixture
def bag(tmp_path):
    path = tmp_path / "scene.mcap"
    write_mcap(path, [some_events()], CAMERA, host_offset=OFFSET)
    return path


def raw_file(path, words, size="64x48"):
    path.write_bytes(f"% format EVT3\n% geometry {size}\n% end\n".encode() + words)
    return path


@pytest.mark.parametrize("encoding", ["mono", "evt3"])
@pytest.mark.parametrize("source", ["mono", "evt3", "raw"])
def test_every_form_holds_the_same_events(tmp_path, capsys, source, encoding):
    events, path = some_events(), tmp_path / f"source.{'raw' if source == 'raw' else 'mcap'}"
    if source == "raw":
        raw_file(path, encoder("evt3")(events)[1])
    else:
        write_mcap(path, [events], CAMERA, source, host_offset=OFFSET)
    output = tmp_path / "deep" / "out.mcap"
    said = facts(capsys, "convert", path, output, "--encoding", encoding)
    assert f"{len(events)} events, {encoding}" in said["written"]
    assert "left out" not in said
    recording, found = all_of(output)
    assert (found == events).all()
    assert recording.format.endswith(encoding)
    if source == "raw":
        assert recording.camera is None
    else:
        assert (recording.camera.K == CAMERA.K).all()
        assert recording.statistics.host_offset == OFFSET


def test_the_camera_can_be_given(tmp_path, bag):
    Camera.pinhole(64, 48, 99.0).write_yaml(tmp_path / "camera.yaml")
    assert main(["convert", str(bag), str(tmp_path / "out.mcap"), "--camera", str(tmp_path / "camera.yaml")]) == 0
    assert open_recording(tmp_path / "out.mcap").camera.focal_px == 99


def test_what_has_no_place_is_said(tmp_path, capsys):
    words = np.frombuffer(encoder("evt3")(some_events(10))[1], "<u2").tolist()
    extra = [0x2001, *words, 0xA001, 0xA000, 0xB000, 0x2000 | 64]
    path = raw_file(tmp_path / "source.raw", np.array(extra, "<u2").tobytes() + b"\0")
    main(["convert", str(path), str(tmp_path / "out.mcap")])
    left_out = [line[12:] for line in capsys.readouterr().out.splitlines() if line.startswith("left out")]
    assert left_out == [
        "2 external triggers",
        "1 events outside the sensor",
        "1 events before the first time or address of their stream",
        "1 words of no known code",
        "1 bytes after the last whole packet",
    ]
    said = facts(capsys, "info", path)
    assert said["triggers"] == "1 rising, 1 falling"
    assert said["range"] == "1 events outside the sensor, dropped"
    assert said["skipped"].startswith("1 events before the first time or address, 1 words of no known code, 1 bytes")


def test_a_text_takes_its_size_from_the_user(tmp_path, capsys):
    path, output = tmp_path / "events.csv", tmp_path / "out.mcap"
    path.write_text("x,y,p,t\n3,4,1,10\n5,2,0,20\n")
    said = facts(capsys, "convert", path, output, "-p", "width:=64", "-p", "height:=48")
    assert "sensor" not in said
    recording, events = all_of(output)
    assert (recording.width, recording.height) == (64, 48)
    assert events.tolist() == [(3, 4, 1, 10_000), (5, 2, 0, 20_000)]
    assert facts(capsys, "convert", path, output)["sensor"].startswith("6x5 px, what the events need")
    assert facts(capsys, "info", path)["sensor"].startswith("6x5 px, what the events need")
    assert "depth" in fails(capsys, "info", path, "-p", "depth:=3")


def test_times_finer_than_the_encoding_are_refused_or_rounded(tmp_path, capsys):
    path, output = tmp_path / "fine.mcap", tmp_path / "out.mcap"
    events = some_events(step=1)
    write_mcap(path, [events], CAMERA)
    assert "no whole microsecond" in fails(capsys, "convert", path, output, "--encoding", "evt3")
    assert not output.exists()
    facts(capsys, "convert", path, output, "--encoding", "evt3", "--round-times")
    assert (all_of(output)[1]["t"] == events["t"] // 1000 * 1000).all()


def test_bad_input_is_one_line(tmp_path, capsys, bag):
    output = tmp_path / "out.mcap"
    assert "nowhere.mcap" in fails(capsys, "convert", tmp_path / "nowhere.mcap", output)
    assert "does not end in .mcap" in fails(capsys, "convert", bag, tmp_path / "out.bag")
    assert "is the recording itself" in fails(capsys, "convert", bag, bag)
    Camera.pinhole(640, 480, 99.0).write_yaml(tmp_path / "camera.yaml")
    assert "640x480" in fails(capsys, "convert", bag, output, "--camera", tmp_path / "camera.yaml")
    assert "'/up'" in fails(capsys, "convert", bag, output, "--topic", "/up")
    assert "no events" in fails(capsys, "convert", raw_file(tmp_path / "none.raw", b""), output)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(bag.read_bytes()[:100])
    assert "cut.mcap" in fails(capsys, "convert", cut, output)
    assert not output.exists()


def test_a_real_recording_keeps_every_event(tmp_path, capsys):
    source = DATA / "ros_bags" / "evt3_ros2_db3"
    if not source.exists():
        pytest.skip("the recordings of ../shared/data are not here (ros_bags/evt3_ros2_db3)")
    for encoding in ("mono", "evt3"):
        said = facts(capsys, "convert", source, tmp_path / "out.mcap", "--encoding", encoding)
        assert said["left out"] == "4157 external triggers"
        assert (all_of(tmp_path / "out.mcap")[1] == all_of(source)[1]).all()


def test_info_in_seconds(capsys, bag):
    events = some_events()
    said, on = facts(capsys, "info", bag), int(events["p"].sum())
    first, last = events["t"][0] / 1e9, events["t"][-1] / 1e9
    peak = np.bincount((events["t"] - events["t"][0]) // 10_000_000).max() / 0.01 / 1e6
    assert said["format"] == "ROS 2 bag (MCAP), mono"
    assert said["sensor"] == "64x48 px"
    assert said["camera"].startswith("in the recording, focal lengths 80 and 80 px")
    assert said["events"] == f"4000 ({on} on, {4000 - on} off)"
    assert said["duration"] == f"{last - first:.6f} s"
    mean = 4000 / (last - first) / 1e6
    assert said["rate"] == f"{mean:.3f} Mev/s mean, {peak:.3f} Mev/s in the busiest 0.01 s"
    assert said["sensor time"] == f"{first:.6f} to {last:.6f} s"
    assert said["host time"].startswith("sensor time +1700000000.000000 s")
    longest = np.diff(events["t"]).max() / 1e9
    start = events["t"][np.argmax(np.diff(events["t"]))] / 1e9 - first
    assert said["gaps"] == (
        f"1 without events for over 0.1 s, the longest {longest:.6f} s, {start:.6f} s after the first event"
    )
    assert longest == pytest.approx(0.5, abs=0.01)
    assert said["order"].startswith("0 events out of order")


def test_a_single_event_has_no_mean_rate(tmp_path, capsys):
    path = tmp_path / "one.mcap"
    write_mcap(path, [some_events(1)], CAMERA)
    said = facts(capsys, "info", path)
    assert (said["duration"], said["rate"]) == ("0.000000 s", "0.000 Mev/s in the busiest 0.01 s")
    assert said["gaps"] == "0 without events for over 0.1 s"


def test_gaps_are_found_across_windows():
    timing = EventTiming()
    for times in ([0, 5], [100_000_005], [300_000_000, 300_000_001], [400_000_002]):
        t = np.array(times)
        timing.add(make_events(t * 0, t * 0, t * 0, t))
    assert (timing.gaps, timing.longest_gap, timing.gap_start, timing.peak) == (2, 199_999_995, 100_000_005, 2)


def test_a_camera_file_tells_the_size_of_the_sensor(tmp_path, capsys):
    words = np.array([[k * 1000, (k % 50) | (k % 40) << 14 | (k & 1) << 28] for k in range(200)], "<u4")
    (tmp_path / "cars.dat").write_bytes(b"% Version 2\n% end\n\x0c\x08" + words.tobytes())
    Camera.pinhole(304, 240, 300.0).write_yaml(tmp_path / "camera.yaml")
    out = tmp_path / "out.mcap"
    assert main(["convert", str(tmp_path / "cars.dat"), str(out), "--camera", str(tmp_path / "camera.yaml")]) == 0
    recording = open_recording(out)
    assert (recording.width, recording.height, recording.camera.focal_px) == (304, 240, 300)
    assert main(["convert", str(tmp_path / "cars.dat"), str(out)]) == 0
    assert "sensor      50x40 px" in capsys.readouterr().out
