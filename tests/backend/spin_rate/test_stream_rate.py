"""The rate from the event stream alone."""

from __future__ import annotations

import numpy as np
import pytest
from turning import flicker_events, levels_of, merged, noise_events, turning_events, wandering_events

from esfo_backend.spin_rate.level_features import Features, correlate
from esfo_backend.spin_rate.period_refinement import refine
from esfo_backend.spin_rate.stream_rate import NoRateError, stream_rate
from esfo_core.events import EVENT_DTYPE

PULL = 4.0
"""Deviations; of some fifty values none should be farther off."""


def slow_correlation(rows, known):
    """Correlation over lags, pair by pair, without the means of the two parts."""
    n = len(rows)
    r = np.full(n, np.nan)
    for lag in range(n):
        pairs = [t for t in range(n - lag) if known[t] and known[t + lag]]
        if len(pairs) < max(0.1 * known.sum(), 2):
            continue
        a = np.array([rows[t] for t in pairs], float)
        b = np.array([rows[t + lag] for t in pairs], float)
        a, b = a - a.mean(axis=0), b - b.mean(axis=0)
        r[lag] = (a * b).sum() / np.sqrt((a * a).sum() * (b * b).sum())
    return r


@pytest.mark.parametrize("holes", [0.0, 0.2, 0.6])
def test_masked_correlation_is_that_of_the_slow_twin(holes):
    rng = np.random.default_rng(round(10 * holes))
    known = rng.random(90) >= holes
    rows = (rng.normal(size=(90, 5)) + np.sin(np.arange(90) / 3)[:, None]).astype(np.float32) * known[:, None]
    found = correlate(Features(0, 1, rows, known, 1, 1.0)).r
    np.testing.assert_allclose(found, slow_correlation(rows, known), atol=2e-5)


@pytest.mark.parametrize("rate_hz", [0.005, 0.05, 0.7, 6.0, 55.0, 300.0, 1000.0])
@pytest.mark.parametrize("turns", [2.4, 9.3])
def test_any_rate_is_found_within_its_deviation(rate_hz, turns):
    found = stream_rate(levels_of(turning_events(rate_hz, turns, seed=round(turns))))
    assert abs(found.rate_hz - rate_hz) < PULL * found.rate_std_hz
    assert found.rate_std_hz < 2e-3 * rate_hz
    assert found.correlation > 0.9
    assert found.constant
    assert found.whole


@pytest.mark.parametrize(("factor", "exact"), [(1024, True), (1000, False)])
def test_the_same_events_slower_give_the_same_rate_scaled(factor, exact):
    events = turning_events(180.0, 6.3, seed=3, start=1_024_000_000)
    slower = events.copy()
    slower["t"] = events["t"] * factor
    a, b = stream_rate(levels_of(events)), stream_rate(levels_of(slower))
    error = abs(b.rate_hz * factor / a.rate_hz - 1)
    assert error < (1e-9 if exact else 1.5 * np.hypot(a.rate_std_hz, b.rate_std_hz * factor) / a.rate_hz)
    assert b.rate_std_hz * factor == pytest.approx(a.rate_std_hz, rel=1e-6 if exact else 0.5)


@pytest.mark.parametrize("turns", [1.2, 1.35, 1.7])
@pytest.mark.parametrize("seed", range(3))
def test_little_more_than_a_turn_is_enough(turns, seed):
    found = stream_rate(levels_of(turning_events(0.4, turns, seed=seed, events=20_000)))
    assert abs(found.rate_hz - 0.4) < PULL * found.rate_std_hz
    assert found.rate_std_hz < 0.01


@pytest.mark.parametrize("turns", [0.4, 0.7, 0.95])
@pytest.mark.parametrize("seed", range(3))
def test_less_than_a_turn_gives_no_rate(turns, seed):
    with pytest.raises(NoRateError):
        stream_rate(levels_of(turning_events(0.4, turns, seed=seed, events=20_000)))


@pytest.mark.parametrize("fold", [2, 3, 12])
def test_the_period_of_a_symmetric_object_is_that_of_its_stream(fold):
    found = stream_rate(levels_of(turning_events(0.8, 6.2, seed=fold, points=10, fold=fold, events=20_000)))
    assert abs(found.rate_hz - 0.8 * fold) < PULL * found.rate_std_hz
    assert any(h.rate_hz == pytest.approx(0.8, rel=0.01) for h in found.alternatives)


def test_a_nearly_symmetric_object_keeps_its_period():
    events = merged(
        turning_events(2.0, 20.0, points=15, fold=2), turning_events(2.0, 20.0, points=3, events=700, seed=5)
    )
    found = stream_rate(levels_of(events))
    assert abs(found.rate_hz - 2.0) < PULL * found.rate_std_hz
    doubled = [h for h in found.alternatives if h.rate_hz == pytest.approx(4.0, rel=0.01)]
    assert doubled
    assert doubled[0].correlation > 0.6
    assert doubled[0].z > 3


def test_turns_that_are_alike_are_not_told_apart_by_where_their_bins_lie():
    """Seven turns are a whole number of bins here, and events are so many that what interpolation lacks is seen."""
    found = stream_rate(levels_of(turning_events(0.1, 60.0, seed=1, events=40_000)))
    assert abs(found.rate_hz - 0.1) < PULL * found.rate_std_hz


def test_a_rotation_of_which_light_is_a_multiple_in_three_turns_is_not_taken_for_these():
    events = merged(turning_events(30.0, 40.0, events=3000), flicker_events(40 / 30, 100.0, 60_000))
    found = stream_rate(levels_of(events))
    assert abs(found.rate_hz - 30.0) < PULL * found.rate_std_hz


def test_an_object_of_40_px_in_a_large_sensor_and_noise():
    size = (1280, 720)
    events = turning_events(30.0, 8.0, radius=20.0, points=8, size=size)
    found = stream_rate(levels_of(merged(events, noise_events(8 / 30, 2000, size=size)), size))
    assert abs(found.rate_hz - 30.0) < PULL * found.rate_std_hz


@pytest.mark.parametrize("seed", range(12))
def test_holes_never_make_another_rate(seed):
    """One long hole, or many short ones: the events are gone, known to be lost or not."""
    rng = np.random.default_rng(seed)
    rate_hz, turns = 3.0, 9.5
    events = turning_events(rate_hz, turns, seed=seed)
    first, last = int(events["t"][0]), int(events["t"][-1])
    if seed % 2:
        length = int(10 ** rng.uniform(-3, np.log10(2 / rate_hz)) * 1e9)
        begins = [int(rng.integers(first, last - length))]
    else:
        length = 4_000_000
        edges = np.arange(first, last, length)
        begins = edges[rng.random(len(edges)) < (0.01, 0.05, 0.2)[seed // 2 % 3]].tolist()
    lost = [(begin, begin + length) for begin in begins]
    for begin, end in lost:
        events = events[(events["t"] < begin) | (events["t"] >= end)]
    for told in (lost, []):
        found = stream_rate(levels_of(events, lost=told))
        assert abs(found.rate_hz - rate_hz) < PULL * found.rate_std_hz


def test_light_that_flickers_is_named_and_no_rate():
    with pytest.raises(NoRateError, match=r"100\.0 Hz in all cells at once, from mains of 50 Hz") as error:
        stream_rate(levels_of(flicker_events(1.0, 100.0, 60_000)))
    assert error.value.reason == "sensor_flicker"
    assert error.value.flicker.rate_hz == pytest.approx(100.0, rel=1e-3)


def test_a_rotation_under_light_that_flickers_is_found():
    events = merged(turning_events(2.0, 8.0, events=10_000), flicker_events(4.0, 100.0, 60_000))
    found = stream_rate(levels_of(events))
    assert abs(found.rate_hz - 2.0) < PULL * found.rate_std_hz
    assert found.flicker is not None
    assert found.flicker.rate_hz == pytest.approx(100.0, rel=1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_what_moves_but_does_not_turn_gets_no_rate(seed):
    for events in (wandering_events(2.0, 40_000, seed), noise_events(1.0, 30_000, seed)):
        with pytest.raises(NoRateError):
            stream_rate(levels_of(events))


def test_few_events_are_named():
    for events in (np.empty(0, EVENT_DTYPE), noise_events(1.0, 100)):
        with pytest.raises(NoRateError) as error:
            stream_rate(levels_of(events))
        assert error.value.reason == "too_few_events"


def test_the_steady_stretch_is_found_behind_a_spin_up():
    steady = turning_events(2.0, 10.0)
    up = turning_events(2.0, 1.5, seed=0)
    s = (up["t"] - up["t"][0]) / 1e9
    up["t"] = up["t"][0] + (np.sqrt(s / s[-1]) * 2 * s[-1] * 1e9).astype(np.int64)
    up["t"] += steady["t"][0] - up["t"][-1] - 1
    found = stream_rate(levels_of(merged(up, steady)))
    assert abs(found.rate_hz - 2.0) < PULL * found.rate_std_hz
    assert not found.whole
    assert found.begin > steady["t"][0] - 5e8


def test_a_rate_that_changes_is_told():
    events = turning_events(2.0, 12.0, events=8000)
    s = (events["t"] - events["t"][0]) / 1e9
    events["t"] = events["t"][0] + ((s + 0.002 * s * s) * 1e9).astype(np.int64)
    found = stream_rate(levels_of(events))
    assert not found.constant
    # 2 Hz / (1 + 0.004 s): over 6 s by 2.4 %.
    assert found.change == pytest.approx(-0.024, rel=0.2)


def test_deviations_are_those_of_the_errors():
    pulls = []
    for seed in range(40):
        turns = (2.3, 5.1, 1.4, 11.0)[seed % 4]
        found = stream_rate(levels_of(turning_events(5.0, turns, seed=seed, events=3000)))
        pulls.append((found.rate_hz - 5.0) / found.rate_std_hz)
    assert 0.7 < np.sqrt(np.mean(np.square(pulls))) < 1.3
    assert np.abs(pulls).max() < PULL


def test_a_small_difference_of_every_other_turn_makes_two_of_them_one():
    alike, other = turning_events(2.0, 8.3, 1, points=15, fold=2, events=6000), turning_events(2.0, 8.3, 5, points=3)
    found = stream_rate(levels_of(merged(alike, other[::13])))
    assert abs(found.rate_hz - 2.0) < PULL * found.rate_std_hz


def test_refinement_corrects_a_period_that_is_off():
    lag = 40.37
    t = np.arange(400)[:, None] / lag
    rows = np.sin(2 * np.pi * (t * np.array([1, 2, 3]) + np.array([0, 0.2, 0.7])))
    rows = (rows + np.random.default_rng(0).normal(0, 0.1, rows.shape)).astype(np.float32)
    found = refine(Features(0, 1, rows, np.ones(400, bool), 1, 1.0), lag * 1.004)
    assert abs(found.lag - lag) < PULL * found.lag_std < 0.04


def test_refinement_needs_a_phase_seen_twice():
    rows = np.random.default_rng(0).normal(size=(90, 4)).astype(np.float32)
    assert refine(Features(0, 1, rows, np.ones(90, bool), 1, 1.0), 95.0) is None
