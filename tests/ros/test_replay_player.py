"""How a recording is cut into packets, and when each may go."""

from pathlib import Path

import numpy as np
import pytest

from esfo_bringup.offline.source import choose_camera
from esfo_bringup.replay.player import MAX_EVENTS, PACKET_NS, Pace, ReplayError, packets
from esfo_core.camera import Camera
from esfo_core.errors import CameraError
from esfo_core.events import make_events
from esfo_core.recordings import open_recording, write_mcap

MS = 1_000_000
CAMERA = Camera.pinhole(64, 48, 60.0)


@pytest.fixture
def recording(tmp_path: Path):
    n = 3 * MAX_EVENTS
    t = np.sort(np.concatenate([np.full(2 * MAX_EVENTS, 500 * MS), 500 * MS + np.arange(MAX_EVENTS) * 4000]))
    events = make_events(np.arange(n) % 64, np.arange(n) % 48, np.arange(n) % 2, t)
    write_mcap(tmp_path / "a.mcap", [events], CAMERA)
    return open_recording(tmp_path / "a.mcap"), events


def test_packets_hold_every_event_once_and_stay_small(recording):
    opened, events = recording
    parts = list(packets(opened, loop=False))
    assert np.array_equal(np.concatenate(parts), events)
    assert all(0 < len(p) <= MAX_EVENTS and p["t"][-1] - p["t"][0] < PACKET_NS for p in parts)


def test_a_loop_goes_on_in_time(recording):
    opened, events = recording
    once = len(list(packets(opened, loop=False)))
    stream = packets(opened, loop=True)
    three = np.concatenate([next(stream) for _ in range(3 * once)])
    assert len(three) == 3 * len(events)
    assert (np.diff(three["t"]) >= 0).all()
    second = three[len(events) : 2 * len(events)]
    assert np.array_equal(second["t"] - second["t"][0], events["t"] - events["t"][0])
    assert 0 < second["t"][0] - events["t"][-1] <= 2 * PACKET_NS


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0])
def test_pace_of_the_wall_clock(rate):
    pace = Pace(rate, 0, 1.0)
    assert pace.delay(1_000 * MS, now=50.0) == 0
    assert pace.delay(1_200 * MS, now=50.0) == pytest.approx(0.2 / rate)
    assert pace.sensor_time(50.0 + 0.1 / rate) == pytest.approx(1_100 * MS, abs=1)
    assert pace.delay(1_200 * MS, now=50.0 + 0.2 / rate) == pytest.approx(0, abs=1e-9)
    assert pace.delay(1_200 * MS, now=60.0) == 0  # late: no negative wait


def test_pace_of_the_acknowledgements():
    pace = Pace(0.0, 300 * MS, stall_s=5.0)
    for k in range(152):
        assert pace.delay(k * 2 * MS, now=0.0) == 0
        pace.sent(k * 2 * MS)
    assert pace.delay(304 * MS, now=1.0) > 0  # 302 ms are under way
    pace.acknowledged(10 * MS, now=4.0)
    assert pace.delay(304 * MS, now=8.0) == 0
    pace.sent(304 * MS)
    # After a pause nothing newer than 304 ms can have been acknowledged: the next packet goes all the same.
    pace.acknowledged(300 * MS, now=8.0)
    pace.acknowledged(20 * MS, now=8.0)  # older news changes nothing
    assert pace.delay(9_000 * MS, now=8.0) == 0
    pace.sent(9_000 * MS)
    pace.acknowledged(300 * MS, now=9.0)
    assert pace.delay(9_002 * MS, now=12.9) > 0
    with pytest.raises(ReplayError, match="300000000 ns was acknowledged for 5 s"):
        pace.delay(9_002 * MS, now=13.1)


def test_camera_of_the_recording_and_from_a_file(recording, tmp_path):
    opened, _ = recording
    assert np.array_equal(choose_camera(opened, "").K, CAMERA.K)
    Camera.pinhole(64, 48, 99.0).write_yaml(tmp_path / "same.yaml")
    assert choose_camera(opened, str(tmp_path / "same.yaml")).K[0, 0] == 99.0
    Camera.pinhole(65, 48, 99.0).write_yaml(tmp_path / "other.yaml")
    with pytest.raises(CameraError, match=r"other.yaml is of 65x48 px, the recording of 64x48"):
        choose_camera(opened, str(tmp_path / "other.yaml"))
