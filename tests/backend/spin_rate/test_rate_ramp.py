"""A rate that changes is found from the stream, and the whole back-end follows it."""

import numpy as np
import pytest
from scenes import CAMERA, NONE_ENDED, spin, tracks_of, unit

from esfo_backend.backend import Backend
from esfo_backend.errors import BackendError
from esfo_backend.options import BackendOptions, InitialisationOptions, SpinRateOptions
from esfo_backend.spin_rate.rate_ramp import find_rate_ramp
from esfo_core.activity import Activity
from esfo_core.events import NS_PER_S
from esfo_core.orbit import angle_between
from esfo_core.tracks import Tracks, TrackUpdate
from esfo_simulation.activity import synthetic_activity

AXIS = unit(0.3, -0.8, 0.4)
RATE = 0.5
BIN = 5_000_000


def seconds_of(turned_s, slope):
    """When an object of rate RATE + slope t shows what one of constant RATE shows at `turned_s`."""
    if not slope:
        return turned_s
    return (np.sqrt(RATE**2 + 2 * slope * RATE * turned_s) - RATE) / slope


def changing_activity(scene, slope, turned_s=4.4):
    """Activity of the scene with its time warped: made in bins of 1 ms, gathered in bins of 5 ms."""
    fine = synthetic_activity(scene.spin, scene.points, CAMERA, turned_s, bin_s=0.001)
    t = seconds_of((np.arange(len(fine.counts)) + 0.5) * 1e-3, slope)
    k = (t * NS_PER_S // BIN).astype(int)
    counts = np.zeros((k.max() + 1, *fine.counts.shape[1:]), np.uint16)
    np.add.at(counts, k, fine.counts)
    return Activity(fine.t0, BIN, fine.cell, counts)


@pytest.mark.parametrize("slope", [0.0, 0.01, -0.02, -0.05])
def test_slope_is_read_from_the_stream(slope):
    scene = tracks_of(spin(AXIS))
    found = find_rate_ramp(changing_activity(scene, slope), SpinRateOptions())
    assert abs(found.slope - slope) < 4 * found.slope_std
    assert found.slope_std < 0.002
    assert found.rate_at(found.span[0]) == pytest.approx(RATE, rel=0.01)


def test_rest_is_cut_off():
    moving = changing_activity(tracks_of(spin(AXIS)), -0.02)
    rest = np.random.default_rng(0).poisson(0.05, (600, *moving.counts.shape[1:])).astype(np.uint16)
    counts = np.concatenate([rest, moving.counts, rest])
    found = find_rate_ramp(Activity(moving.t0 - 600 * BIN, BIN, moving.cell, counts), SpinRateOptions())
    assert found.slope == pytest.approx(-0.02, abs=4 * found.slope_std)
    assert abs(found.span[0] - moving.t0) < 0.1 * NS_PER_S
    assert abs(found.span[1] - moving.end) < 0.1 * NS_PER_S


def test_noise_has_no_changing_rate():
    rng = np.random.default_rng(1)
    walk = np.abs(np.cumsum(rng.normal(size=(800, 2, 15, 20)), axis=0)).astype(np.uint16)
    for counts in (rng.poisson(2.0, (800, 2, 15, 20)).astype(np.uint16), walk):
        with pytest.raises(BackendError, match="does not repeat"):
            find_rate_ramp(Activity(0, BIN, 32, counts), SpinRateOptions())


@pytest.mark.parametrize("slope", [0.01, -0.05])
def test_backend_follows_a_changing_rate(slope):
    scene = tracks_of(spin(AXIS), noise_px=0.5)
    t0 = scene.spin.t0
    t = t0 + np.round(seconds_of((scene.tracks.t - t0) / NS_PER_S, slope) * NS_PER_S).astype(np.int64)
    tracks = Tracks(scene.tracks.track_id, t, scene.tracks.uv, scene.tracks.sigma)
    backend = Backend(CAMERA, BackendOptions(initialisation=InitialisationOptions(method="direct")))
    backend.add(TrackUpdate(tracks, NONE_ENDED), changing_activity(scene, slope, 4.0))
    estimate = backend.solve()
    assert estimate.status == "degenerate", estimate.reason
    assert estimate.flags[0] == "rate_not_constant"
    assert abs(estimate.rate_slope_hz_s - slope) < 4 * estimate.rate_slope_std_hz_s
    assert estimate.rate_slope_std_hz_s < 0.02 * abs(slope)
    at_t0 = RATE + slope * (estimate.spin.t0 - t0) / NS_PER_S
    assert abs(estimate.spin.rate_hz - at_t0) < 4 * estimate.rate_std_hz + 1e-4
    assert angle_between(estimate.spin.axis, AXIS) < 3 * estimate.axis_std_deg


def test_an_error_that_all_cells_share_is_in_the_deviation():
    """Cells that all see the same agree perfectly: leaving some out shows no error. A tenth of a bin remains."""
    turned = np.cumsum(np.full(800, 0.004))  # 3.2 turns in 4 s
    light = 100 + 80 * np.cos(2 * np.pi * turned) + 60 * np.cos(6 * np.pi * turned + 1)
    counts = np.broadcast_to(light.astype(np.uint16)[:, None, None, None], (800, 2, 4, 4)).copy()
    found = find_rate_ramp(Activity(0, BIN, 32, counts), SpinRateOptions())
    tenth_of_a_bin = 8 * 0.1 * 0.005 / 4.0**2  # of the warp of time in the middle
    assert found.relative_slope_std >= 0.99 * tenth_of_a_bin
    assert found.relative_slope_std < 3 * tenth_of_a_bin
    assert abs(found.relative_slope) < 4 * found.relative_slope_std
