"""The rate from the event stream."""

import contextlib

import numpy as np
import pytest
from scenes import CAMERA, spin, unit

from esfo_backend.errors import BackendError
from esfo_backend.options import SpinRateOptions
from esfo_backend.spin_rate.correlation import _clearly_worse, _delay, _difference, correlation_rate, fourier_rate
from esfo_core.activity import Activity
from esfo_core.orbit import rotation
from esfo_simulation.activity import synthetic_activity


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


@pytest.mark.parametrize("lag", [11.0, 20.25, 31.5, 47.93])
def test_values_between_bins_are_exact_within_the_band(lag):
    t, frequency = np.arange(120.0), np.linspace(0.0, 0.3, 31)

    def waves(at):
        return np.cos(2 * np.pi * at[:, None] * frequency + frequency * 100)

    first, weights = _delay(lag)
    rows = np.arange(8, 50)
    found = sum(w * waves(t)[rows + first + i] for i, w in enumerate(weights))
    np.testing.assert_allclose(found, waves(t[rows] + lag), atol=1e-3)


def test_difference_is_that_of_shifted_features():
    features = np.random.default_rng(0).normal(size=(80, 5))
    (first, a), (second, b) = _delay(30.3), _delay(12.8)
    rows = np.arange(8, 40)
    gap = sum(a[i] * features[rows + first + i] - b[i] * features[rows + second + i] for i in range(16))
    total, squares = _difference(features, (8, 40), first, a, second, b)
    assert total == pytest.approx((features[rows] * gap).sum(), rel=1e-12)
    assert squares == pytest.approx(((features[rows] * gap) ** 2).sum(), rel=1e-12)


def test_a_peak_at_the_longest_lag_is_no_crash():
    """Between the bins its maximum may lie beyond the last lag: refused like any other that does not repeat."""
    for seed in range(200):
        walk = np.abs(np.cumsum(np.random.default_rng(seed).normal(size=(60, 2, 2, 2)), axis=0)).astype(np.uint16)
        with contextlib.suppress(BackendError):
            assert correlation_rate(Activity(0, 5_000_000, 32, walk), SpinRateOptions()).rate_hz > 0


@pytest.mark.parametrize("alike", [0, 40, 55])
@pytest.mark.parametrize(("rate_hz", "turns"), [(0.25, 1.09), (0.25, 1.2), (1.0, 1.12), (2.0, 1.2)])
def test_little_more_than_a_turn_is_enough_whatever_half_a_turn_looks_like(rate_hz, turns, alike):
    """`alike`: how many of 60 points have another one opposite to them."""
    axis = unit(0.3, -0.8, 0.4)
    points = ball(60)
    both = np.concatenate([points, points[:alike] @ rotation(axis, np.pi).T])
    activity = synthetic_activity(spin(axis, rate_hz), both, CAMERA, turns / rate_hz)
    assert correlation_rate(activity, SpinRateOptions()).rate_hz == pytest.approx(rate_hz, rel=0.01)


def test_a_mismatch_three_times_as_large_is_clearly_worse():
    lags = np.arange(401)
    for at_half, worse in ((0.93, False), (0.86, False), (0.8, True), (0.3, True)):
        r = np.interp(lags, [0, 50, 100, 150, 200, 400], [1.0, 0.0, at_half, 0.0, 0.94, 0.0])
        assert _clearly_worse(r, 200.0, 100.0) == worse
    # Too few bins to read a narrow peak between two of them: nothing is said.
    assert not _clearly_worse(r, 40.0, 20.0)
