"""The back-end on topics: waiting for the camera, time that goes back, a grid of another sensor."""

import numpy as np
import pytest

from esfo_backend.options import BackendOptions
from esfo_backend.ros import live_backend as live_module
from esfo_backend.ros.live_backend import LiveBackend, verdict_values
from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.errors import CameraError
from esfo_core.estimate import OrbitEstimate
from esfo_core.estimate_text import one_line
from esfo_core.tracks import Tracks, TrackUpdate

MS = 1_000_000
CAMERA = Camera.pinhole(64, 48, 60.0)


def activity(t0, bins=10, grid=(2, 2)):
    return Activity(t0, 5 * MS, 32, np.ones((bins, 2, *grid), np.uint16))


def update(n=3):
    return TrackUpdate(Tracks.from_columns(range(n), range(n), np.ones((n, 2)), np.ones(n)), np.empty(0, np.uint32))


@pytest.fixture
def live():
    return LiveBackend(BackendOptions())


def test_what_comes_before_the_camera_is_kept(live):
    live.add_tracks(update(3))
    live.add_activity(activity(0))
    assert not live.due()
    assert live.solve().reason == "no camera_info received"
    live.set_camera(CAMERA)
    live.add_tracks(update(4))
    assert live._backend.counts() == (7, 10)
    assert (live.observations, live.activity_bins, live.dropped) == (7, 10, 0)


def test_too_much_before_the_camera_is_counted(live, monkeypatch):
    monkeypatch.setattr(live_module, "MAX_WAITING", 5)
    for _ in range(8):
        live.add_tracks(update(1))
    live.set_camera(CAMERA)
    assert live.dropped == 3
    assert live._backend.counts() == (5, 0)


def test_the_same_camera_again_changes_nothing_but_another_begins_anew(live):
    live.set_camera(CAMERA)
    live.add_tracks(update())
    live.set_camera(Camera.pinhole(64, 48, 60.0))
    assert live._backend.counts() == (3, 0)
    live.set_camera(Camera.pinhole(64, 48, 61.0))
    assert live._backend.counts() == (0, 0)


def test_time_that_goes_back_begins_anew(live):
    live.set_camera(CAMERA)
    live.add_activity(activity(10_000 * MS))
    live.add_tracks(update())
    live.add_activity(activity(10_050 * MS))
    assert live.restarts == 0
    live.add_activity(activity(0))
    assert live.restarts == 1
    assert live._backend.counts() == (0, 10)
    assert live.activity_bins == 30


@pytest.mark.parametrize("grid", [(2, 3), (1, 2)])
def test_activity_of_another_sensor_is_refused(live, grid):
    live.set_camera(CAMERA)
    with pytest.raises(CameraError, match=f"64x48 px, the events of a sensor of {grid[1]}x{grid[0]} cells"):
        live.add_activity(activity(0, grid=grid))


def test_data_that_allow_no_estimate_give_a_failure_that_says_why(live):
    live.set_camera(CAMERA)
    live.add_activity(activity(0))
    live.add_activity(activity(10 * MS))  # overlaps: another front-end publishes, too
    estimate = live.solve()
    assert estimate.status == "failed"
    assert "overlaps" in estimate.reason
    assert one_line(estimate) == f"failed: {estimate.reason}"
    assert verdict_values(estimate)["reason"] == estimate.reason
    assert verdict_values(None) == {"status": "no estimate yet"}
    assert "nothing" in one_line(OrbitEstimate.failure("nothing"))
