"""The rate from the event stream."""

import numpy as np
import pytest
from scenes import CAMERA, spin, unit

from esfo_backend.errors import BackendError
from esfo_backend.options import SpinRateOptions
from esfo_backend.spin_rate import correlation_rate, fourier_rate
from esfo_core.activity import Activity
from esfo_core.orbit import rotation
from esfo_core.simulation.activity import synthetic_activity


def ball(count, seed=0):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3))
    return 1.2 * points / np.linalg.norm(points, axis=1)[:, None]


@pytest.mark.parametrize("rate_hz", [0.31, 0.5, 1.7])
@pytest.mark.parametrize("turns", [1.8, 2.5, 5.2])
def test_correlation_finds_the_period(rate_hz, turns):
    activity = synthetic_activity(spin(unit(0.3, -0.8, 0.4), rate_hz), ball(60), CAMERA, turns / rate_hz)
    found = correlation_rate(activity, SpinRateOptions())
    # A twentieth of a bin of 5 ms.
    assert found.rate_hz == pytest.approx(rate_hz, rel=0.05 * 0.005 * rate_hz)


@pytest.mark.parametrize("fold", [2, 4])
def test_nearly_symmetric_object_keeps_its_period(fold):
    axis = unit(0.3, -0.8, 0.4)
    quarter = ball(20)
    points = np.concatenate([quarter @ rotation(axis, 2 * np.pi * k / fold).T for k in range(fold)])
    points = np.concatenate([points, ball(6, seed=9)])  # what breaks the symmetry
    activity = synthetic_activity(spin(axis), points, CAMERA, 5.0)
    found = correlation_rate(activity, SpinRateOptions())
    assert found.rate_hz == pytest.approx(0.5, rel=0.001)
    harmonic = [h for h in found.harmonics if h.rate_hz == pytest.approx(0.5 * fold, rel=0.03)]
    assert harmonic, "the rejected harmonic is reported"
    assert harmonic[0].correlation > 0.25


def test_what_does_not_repeat_is_refused():
    rng = np.random.default_rng(1)
    walk = np.abs(np.cumsum(rng.normal(size=(800, 2, 15, 20)), axis=0)).astype(np.uint16)
    for counts in (rng.poisson(2.0, (800, 2, 15, 20)).astype(np.uint16), walk):
        with pytest.raises(BackendError, match="does not repeat"):
            correlation_rate(Activity(0, 5_000_000, 32, counts), SpinRateOptions())


def test_fourier_rate_is_within_its_bin():
    points = ball(60, seed=3)
    lopsided = points[points[:, 0] > 0]  # with detail on all sides the strongest bin is a harmonic
    activity = synthetic_activity(spin(unit(0.1, -0.99, 0.1)), lopsided, CAMERA, 8.0)
    assert fourier_rate(activity, 0.02) == pytest.approx(0.5, abs=1 / 8.0)


def test_empty_activity_is_refused():
    nothing = Activity(0, 5_000_000, 32, np.zeros((100, 2, 15, 20), np.uint16))
    with pytest.raises(BackendError, match="too few"):
        correlation_rate(nothing, SpinRateOptions())
    with pytest.raises(BackendError, match="too few"):
        fourier_rate(Activity(0, 5_000_000, 32, np.zeros((3, 2, 15, 20), np.uint16)), 0.02)
