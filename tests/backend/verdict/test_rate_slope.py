"""A rate that changes is found, one that does not is left alone."""

import numpy as np
import pytest
from scenes import CAMERA, NONE_ENDED, spin, tracks_of, unit

from esfo_backend.adjustment.bundle_adjustment import bundle_adjustment, linear_points
from esfo_backend.backend import Backend
from esfo_backend.options import BackendOptions, InitialisationOptions
from esfo_backend.orbit.observations import observations
from esfo_backend.orbit.parametrization import motion_from_axis
from esfo_backend.verdict.rate_slope import rate_slope
from esfo_core.tracks import Tracks, TrackUpdate
from esfo_simulation.activity import synthetic_activity

AXIS = unit(0.3, -0.8, 0.4)


def warped(scene, slope):
    """The same tracks, seen at times at which an object of rate 0.5 + slope t shows them; t from the first row."""
    t = scene.tracks.t
    turned = 0.5 * (t - t.min()) / 1e9
    if slope:
        seconds = (np.sqrt(0.25 + 2 * slope * turned) - 0.5) / slope
        t = t.min() + np.round(seconds * 1e9).astype(np.int64)
    return Tracks(scene.tracks.track_id, t, scene.tracks.uv, scene.tracks.sigma)


@pytest.mark.parametrize("slope", [0.0, 0.002, -0.004])
def test_slope_is_recovered_within_its_deviation(slope):
    scene = tracks_of(spin(AXIS), noise_px=0.5, track_s=1.2)
    obs, ids = observations(warped(scene, slope), CAMERA, 4)
    _, label = np.unique(scene.point_of_track[ids], return_inverse=True)
    obs = obs.regroup(label.astype(np.int64))
    start = motion_from_axis(AXIS, scene.spin.center, 0.5 + 2 * slope)
    solution = bundle_adjustment(start, linear_points(start, obs), obs, 5.0)
    drift = rate_slope(solution, obs, 5.0)
    assert abs(drift.slope - slope) < 3.5 * drift.std + 0.05 * abs(slope)
    assert drift.std < 3e-4
    assert (drift.significance > 4) == (slope != 0)


def test_backend_names_a_changing_rate():
    scene = tracks_of(spin(AXIS), noise_px=0.5)
    slow = warped(scene, -0.002)
    activity = synthetic_activity(scene.spin, scene.points, CAMERA, 4.0)
    backend = Backend(CAMERA, BackendOptions(initialisation=InitialisationOptions(method="direct")))
    backend.add(TrackUpdate(slow, NONE_ENDED), activity)
    estimate = backend.solve()
    assert estimate.status != "ok"
    assert "rate_not_constant" in estimate.flags or estimate.status == "failed"
