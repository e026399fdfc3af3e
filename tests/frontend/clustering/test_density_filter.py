"""Neighbour counts against exact fractions, however the stream comes; the mean as the paper has it."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_core.events import make_events
from esfo_frontend.clustering import neighbour_counter as neighbours
from esfo_frontend.clustering.density_filter import DensityFilter
from esfo_frontend.clustering.neighbour_counter import NeighbourCounter, neighbourhood
from esfo_frontend.options import PRESETS, DensityOptions


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
    t = np.cumsum(rng.integers(0, t_step + 1, n)) + rng.choice([-5_000_000, 0, 2**60])
    return make_events(rng.integers(0, size[0], n), rng.integers(0, size[1], n), rng.integers(0, 2, n), t)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.5, 1.0, 2.5, 5.0, 7.0]),
    st.sampled_from([300.0, 1000.0, 123.4]),
    st.sampled_from([0, 1000, 1_000_000, 10_000_000]),
    st.sampled_from([(12, 12), (1, 30), (33, 3), (8, 16), (300, 2)]),
)
def test_counts_equal_twin_in_any_packets_and_batches(seed, radius, time_scale, t_step, size):
    rng = np.random.default_rng(seed)
    events = random_events(rng, 100, size, t_step)
    corner = rng.random(100) < 0.3
    counter = NeighbourCounter(*size, neighbourhood(radius, time_scale))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(neighbours, "_BATCH", int(rng.integers(1, 60)))
        taken, borders = [], range(0, 100, int(rng.integers(1, 70)))
        for piece, marks in zip(np.split(events, borders), np.split(corner, borders), strict=True):
            counter.add(piece, marks)
            if len(piece) and rng.random() < 0.5:
                taken.append(counter.take(int(piece["t"][-1]) - counter.reach - int(rng.integers(0, t_step + 1))))
    taken.append(counter.take(2**62))
    assert counter.idle
    corners, counts = (np.concatenate(part) for part in zip(*taken, strict=True))
    assert np.array_equal(corners, events[corner])
    assert counts.tolist() == count_twin(corners, events, radius, time_scale)


@pytest.mark.parametrize(("x", "half"), [(10, 5_000_000), (13, 4_000_000)])
def test_distance_exactly_lambda_is_inside(x, half):
    # 5 px radius, 1000 px/s: (3, 0) px and 4 ms are exactly 5 px away, one nanosecond more is not.
    for after, inside in ((half, True), (half + 1, False), (-half, True), (-half - 1, False)):
        events = make_events(*(np.array(v) for v in ((10, x), (10, 10), (1, 1), (0, after))))
        order = np.argsort(events["t"])
        counter = NeighbourCounter(20, 20, neighbourhood(5.0, 1000.0))
        counter.add(events[order], np.array([True, False])[order])
        assert counter.take(2**62)[1].tolist() == [1 + inside]


def test_events_of_one_time_in_two_packets(monkeypatch):
    monkeypatch.setattr(neighbours, "_BATCH", 1)
    counter = NeighbourCounter(20, 20, neighbourhood(5.0, 1000.0))
    for times in ([-10_000_000, 0, 5_000_000], [5_000_000, 30_000_000]):
        n = len(times)
        counter.add(make_events(np.full(n, 9), np.full(n, 9), np.ones(n), np.array(times)), np.array(times) == 0)
    assert counter.take(2**62)[1].tolist() == [3]


def test_memory_stays_bounded_without_take():
    rng = np.random.default_rng(0)
    counter = NeighbourCounter(64, 48, neighbourhood(7.0, 1000.0))
    held = []
    for i in range(40):
        n = 20_000
        t = i * 10_000_000 + np.sort(rng.integers(0, 10_000_000, n))
        counter.add(make_events(rng.integers(0, 64, n), rng.integers(0, 48, n), rng.integers(0, 2, n), t), t < 0)
        held.append(sum(map(len, counter._events)))
    # 2 events per us: three reaches of 7 ms, and what comes until a batch is full.
    assert max(held) < 3 * 7_000 * 2 + (1 << 16) + 20_000


def run_filter(events, corner, stage, borders):
    """Kept corners per slice, with all events added as soon as a slice needs them."""
    kept, start = [], 0
    for border in borders:
        n = int(np.searchsorted(events["t"], border + stage.reach))
        stage.add(events[start:n], corner[start:n])
        start = n
        kept.append(stage.filter_until(border)[0])
    assert stage.idle
    return kept


@pytest.mark.parametrize("memory", [0.0, 0.004, 1.0])
def test_filter_keeps_what_reaches_the_mean_of_its_polarity_so_far(memory):
    rng = np.random.default_rng(3)
    events = random_events(rng, 2000, (24, 24), 20_000)
    events["t"] -= events["t"][0]
    corner = rng.random(2000) < 0.1
    radius, scale = 4.0, 1000.0
    stage = DensityFilter(24, 24, scale, DensityOptions(radius=radius, memory=memory))
    borders = [6_000_000, 12_000_000, 12_500_000, 30_000_000]
    kept = run_filter(events, corner, stage, borders)

    corners = events[corner]
    score = np.array(count_twin(corners, events, radius, scale)) / radius
    expected, lower = [], 0
    for border in borders:
        sofar = corners["t"] < border
        age = (corners["t"][sofar].max() - corners["t"]) * 1e-9
        weight = np.exp(-age / memory) if memory else np.ones(len(corners))
        mean = np.array(
            [np.average(score[s], weights=weight[s]) for s in (sofar & (corners["p"] == q) for q in (0, 1))]
        )
        chosen = sofar & (corners["t"] >= lower) & (score >= mean[corners["p"]])
        expected.append(corners[chosen])
        lower = border
    for a, b in zip(kept, expected, strict=True):
        assert len(b) > 3
        assert np.array_equal(a, b)


def test_paper_preset_equals_the_batch_over_the_whole_recording(scene):
    # With one slice the running mean is the mean of the paper: over all corners of the recording.
    preset = PRESETS["paper"]
    rng = np.random.default_rng(2)
    corner = rng.random(len(scene.events)) < 0.05
    stage = DensityFilter(scene.width, scene.height, preset.time_scale, preset.density)
    for piece, marks in zip(*(np.array_split(a, 50) for a in (scene.events, corner)), strict=True):
        stage.add(piece, marks)
    kept, scored = stage.filter_until(2**62)

    corners = scene.events[corner]
    events = scene.events
    near = [events[np.abs(events["t"] - c["t"]) <= stage.reach] for c in corners]
    count = np.array(
        [count_twin(np.array([c]), e, 7.0, preset.time_scale)[0] for c, e in zip(corners, near, strict=True)]
    )
    mean = np.array([count[corners["p"] == q].mean() for q in (0, 1)])
    assert scored == len(corners) > 500
    assert np.array_equal(kept, corners[count >= mean[corners["p"]]])


def test_memory_follows_a_scene_that_becomes_sparse():
    # 50 events around each corner, later 5 and at the end 7: that is much, once the dense past is forgotten.
    def burst(t, n):
        return make_events(np.full(n, 10), np.full(n, 10), np.ones(n), np.full(n, t))

    second = 1_000_000_000
    events = np.concatenate([burst(i * second, 50 if i < 10 else 7 if i == 199 else 5) for i in range(200)])
    corner = np.zeros(len(events), bool)
    corner[np.unique(events["t"], return_index=True)[1]] = True
    borders = (np.arange(200) * second + 1).tolist()
    for memory, last_kept in ((0.0, 0), (10.0, 1)):
        stage = DensityFilter(20, 20, 1000.0, DensityOptions(memory=memory))
        assert [len(k) for k in run_filter(events, corner, stage, borders)][-1] == last_kept


def test_long_pause_leaves_a_mean():
    first, second = (make_events(*(np.array([v]) for v in (5, 5, 1, t))) for t in (-(2**50), 2**50))
    stage = DensityFilter(20, 20, 300.0, DensityOptions(memory=0.01))
    for event in (first, second):
        stage.add(event, np.array([True]))
        kept, scored = stage.filter_until(int(event["t"][0]) + 1)
        assert scored == len(kept) == 1


def test_polarity_without_corners_has_no_mean_and_no_warning():
    stage = DensityFilter(20, 20, 300.0, DensityOptions())
    only_on = make_events(*(np.array([v]) for v in (5, 5, 1, 0)))
    stage.add(only_on, np.array([True]))
    kept, scored = stage.filter_until(1)
    assert scored == 1
    assert len(kept) == 1
