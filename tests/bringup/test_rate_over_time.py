"""The rate over time that a report shows, against streams of which the phase is known."""

import numpy as np
import pytest

from esfo_bringup.results.rate_over_time import rate_over_time
from esfo_core.activity import Activity

BIN = 5_000_000


def activity(phase, duration_s, seed=2):
    """Counts of a random pattern that is a function of the phase (turns) alone, with the noise of counting."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(duration_s * 1e9 / BIN)) * BIN / 1e9
    harmonics = np.arange(1, 12)
    weights = rng.normal(size=(2, 11, 2 * 6 * 8)) / harmonics[None, :, None]
    angle = 2 * np.pi * phase(t)[:, None] * harmonics
    mean = 60 * np.exp(0.5 * (np.cos(angle) @ weights[0] + np.sin(angle) @ weights[1]))
    counts = np.minimum(rng.poisson(mean), 65535).astype(np.uint16)
    return Activity(7 * BIN, BIN, 32, counts.reshape(-1, 2, 6, 8))


@pytest.mark.parametrize("rate", [0.4, 2.0, 7.3])
def test_a_constant_rate_is_found_all_the_time(rate):
    rates = rate_over_time(activity(lambda t: rate * t, 6 / rate), rate * 1.01)
    assert len(rates.t_s) >= 9
    error = 1e-3 + 0.2 * rate * BIN / 1e9  # a third of a degree by the noise of counting, and a fifth of a bin
    np.testing.assert_allclose(rates.rate_hz, rate, rtol=error)
    assert abs(np.median(rates.rate_hz) / rate - 1) < 0.3 * error
    assert 0.5 / rate < rates.t_s[0] < 0.8 / rate
    assert 4.9 / rate < rates.t_s[-1] < 5.5 / rate


def test_a_changing_rate_is_followed():
    rate, slope = 0.8, -0.02
    rates = rate_over_time(activity(lambda t: rate * t + slope * t**2 / 2, 5.0), 0.75)
    # Over a turn centred at t the mean of a rate that changes linearly is the rate at t.
    np.testing.assert_allclose(rates.rate_hz, rate + slope * rates.t_s, rtol=2e-3)
    assert np.polyfit(rates.t_s, rates.rate_hz, 1)[0] == pytest.approx(slope, rel=0.1)


def test_what_is_too_short_or_does_not_repeat_gives_nothing():
    assert len(rate_over_time(activity(lambda t: 0.5 * t, 2.1), 0.5).t_s) == 0
    still = Activity(0, BIN, 32, np.full((400, 2, 6, 8), 3, np.uint16))
    assert len(rate_over_time(still, 1.0).t_s) == 0
    assert len(rate_over_time(activity(lambda t: 0.5 * t, 4.0), 500.0).t_s) == 0
