"""Recorded messages as a topic would bring them: live, they are what reading the recording gives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import Reader

from esfo_core.packets import SUPPORTED, packet_from_cdr, sequence_of
from esfo_core.recordings import open_recording
from esfo_frontend.frontend import Frontend
from esfo_frontend.online.clock_offset import DRIFT
from esfo_frontend.online.live_frontend import LiveFrontend
from esfo_frontend.options import PRESETS

BAGS = Path(__file__).resolve().parents[4] / "shared" / "data" / "ros_bags"


def columns(outputs):
    """Corners with their places, times and tracks, and the places of the rows of tracks."""
    corners = [np.concatenate([getattr(o.corners, name) for o in outputs]) for name in ("x", "y", "t", "label")]
    return [*corners, np.concatenate([o.tracks.observations.uv for o in outputs])]


@pytest.mark.parametrize("name", ["evt3_ros2_db3", "libcaer_rollover_ros2_db3"])
def test_messages_of_a_camera(name):
    path = BAGS / name
    if not path.exists():
        pytest.skip(f"no recording {path}")
    with Reader(path) as reader:
        topics = [c for c in reader.connections if c.msgtype in SUPPORTED]
        messages = [(c.msgtype, bytes(data)) for c, _, data in reader.messages(connections=topics)]
    recording = open_recording(path)
    chunks = list(recording.chunks())
    frontend = Frontend(recording, PRESETS["default"])
    expected = columns([*map(frontend.process, chunks), frontend.flush()])
    live, outputs, differences, offsets, times = LiveFrontend(PRESETS["default"]), [], [], [], []
    for kind, data in messages:
        live.arrived(sequence_of(kind, data))
        packet = packet_from_cdr(kind, data)
        outputs += live.process(packet)
        if len(live.events):
            times.append(int(live.events["t"][0]))
            differences.append(packet.stamp - times[-1])
            offsets.append(live.offset)
    outputs += live.flush()
    totals = live.totals
    assert totals.events == sum(map(len, chunks))
    assert (totals.lost, totals.late, totals.stale, totals.restarts, totals.unreadable) == (0, 0, 0, 0, 0)
    assert all((a == b).all() for a, b in zip(columns(outputs), expected, strict=True))
    assert len(expected[0]) > 3000
    # The offset is that of the fastest packet so far, but for drift since then; to fall to it, it takes twice the fall.
    t, difference = np.array(times), np.array(differences)
    known = np.searchsorted(t, t - 2 * np.ptp(difference), side="right") - 1
    fastest = np.minimum.accumulate(difference)
    ahead = np.array(offsets) - fastest
    assert ahead.min() >= 0
    assert (np.array(offsets) - fastest[known] <= 1 + (t - t[0]) / DRIFT)[known >= 0].all()
