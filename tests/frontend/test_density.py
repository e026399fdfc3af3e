"""Neighbour counts against exact fractions; the mean as the paper has it."""

from fractions import Fraction

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_core.events import make_events
from esfo_frontend.density import DensityFilter, count_neighbours, neighbourhood
from esfo_frontend.options import DensityOptions


def count_twin(corners, events, radius, time_scale):
    """All pairs, distance in (x, y, scaled t) in exact arithmetic."""
    scale, limit = Fraction(time_scale) / 10**9, Fraction(radius) ** 2
    return [
        sum(
            p == q and (x - u) ** 2 + (y - v) ** 2 + ((t - s) * scale) ** 2 <= limit
            for u, v, q, s in events.tolist()
        )
        for x, y, p, t in corners.tolist()
    ]  # fmt: skip


def random_events(rng, n, size, t_step):
    t = np.cumsum(rng.integers(0, t_step + 1, n))
    return make_events(rng.integers(0, size, n), rng.integers(0, size, n), rng.integers(0, 2, n), t)


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([1.0, 2.5, 5.0, 7.0]),
    st.sampled_from([300.0, 1000.0, 123.4]),
    st.sampled_from([0, 1000, 1_000_000]),
)
def test_counts_equal_twin(seed, radius, time_scale, t_step):
    rng = np.random.default_rng(seed)
    events = random_events(rng, 60, 12, t_step)
    corners = events[rng.random(60) < 0.3]
    counts = count_neighbours(corners, events, neighbourhood(radius, time_scale), (12, 12))
    assert counts.tolist() == count_twin(corners, events, radius, time_scale)


def test_distance_exactly_lambda_is_inside():
    # 5 px radius, 1000 px/s: (3, 0) px and 4 ms are exactly 5 px away, one nanosecond more is not.
    corner = make_events(*(np.array([v]) for v in (10, 10, 1, 10_000_000)))
    for t, inside in ((14_000_000, True), (14_000_001, False), (6_000_000, True), (5_999_999, False)):
        event = make_events(*(np.array([v]) for v in (13, 10, 1, t)))
        assert count_neighbours(corner, event, neighbourhood(5.0, 1000.0), (20, 20))[0] == inside


def test_filter_keeps_what_reaches_the_mean_of_its_polarity_so_far():
    rng = np.random.default_rng(3)
    events = random_events(rng, 2000, 24, 20_000)
    corner = rng.random(2000) < 0.1
    radius, scale = 4.0, 1000.0
    stage = DensityFilter(24, 24, scale, DensityOptions(radius=radius))
    borders = [6_000_000, 12_000_000, 30_000_000]
    kept, start = [], 0
    for border in borders:
        n = int(np.searchsorted(events["t"], border + stage.reach))
        stage.add(events[start:n], corner[start:n])
        start = n
        kept.append(stage.filter_until(border)[0])
    assert stage.idle

    corners = events[corner]
    score = np.array(count_twin(corners, events, radius, scale)) / radius
    expected, lower = [], 0
    for border in borders:
        sofar = corners["t"] < border
        mean = np.array([score[sofar & (corners["p"] == q)].mean() for q in (0, 1)])
        chosen = sofar & (corners["t"] >= lower) & (score >= mean[corners["p"]])
        expected.append(corners[chosen])
        lower = border
    for a, b in zip(kept, expected, strict=True):
        assert len(b) > 5
        assert np.array_equal(a, b)


def test_polarity_without_corners_has_no_mean_and_no_warning():
    stage = DensityFilter(20, 20, 300.0, DensityOptions())
    only_on = make_events(*(np.array([v]) for v in (5, 5, 1, 0)))
    stage.add(only_on, np.array([True]))
    kept, scored = stage.filter_until(1)
    assert scored == 1
    assert len(kept) == 1
