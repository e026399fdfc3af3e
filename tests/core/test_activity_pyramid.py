"""Counts at all resolutions: those of a plain loop, in bounded memory, the same in any packets."""

from __future__ import annotations

import numpy as np
import pytest

from esfo_core.activity import Activity, ActivityError
from esfo_core.activity_pyramid import BINS, WINDOW, ActivityPyramid
from esfo_core.events import make_events
from esfo_core.image_region import Region, box_of, moved, region_about, union
from esfo_core.pyramid_counter import FIRST_EVENTS, PyramidCounter

MS = 1_000_000
SIZE = (200, 100)


def random_events(seed, n, duration, box=(60, 120, 20, 60), start=1_700_000_000_000_000_123):
    rng = np.random.default_rng(seed)
    x0, x1, y0, y1 = box
    t = start + np.sort(rng.integers(0, duration, n))
    return make_events(rng.integers(x0, x1, n), rng.integers(y0, y1, n), rng.integers(0, 2, n), t)


def pyramid_of(packets, size=SIZE):
    counter, pyramid = PyramidCounter(*size), ActivityPyramid()
    for packet in packets:
        counter.add(packet)
        pyramid.add(counter.take())
    counter.finish()
    pyramid.add(counter.take())
    return pyramid


def plain_counts(events, activity, region):
    """Counts of the bins of an activity, by walking through the events."""
    counts = np.zeros(activity.counts.shape, int)
    for x, y, p, t in events.tolist():
        k, r, c = (
            (t - activity.t0) // activity.bin,
            y // region.cell - region.row,
            x // region.cell - region.column,
        )
        if 0 <= k < len(counts) and 0 <= r < region.rows and 0 <= c < region.columns:
            counts[k, p, r, c] += 1
    return counts


def test_every_level_has_the_counts_of_a_plain_loop():
    events = random_events(0, 6000, 300 * MS)
    pyramid = pyramid_of([events])
    region = region_about(box_of(np.bincount(events["x"]), np.bincount(events["y"])), *SIZE)
    levels = pyramid.levels()
    half_seen = [b for b in BINS if b <= 2 * 300 * MS]  # a bin of which less was seen is missing
    assert [level.bin for level in levels] == half_seen
    for level in levels:
        assert level.t0 % level.bin == 0
        inner = level.part(1, len(level.counts) - 1)  # the first and the last bin are scaled by what was seen of them
        assert np.array_equal(inner.counts, plain_counts(events, inner, region))
        assert inner.valid.all()


@pytest.mark.parametrize("seed", range(5))
def test_packets_make_no_difference(seed):
    rng = np.random.default_rng(seed)
    still = random_events(seed, 5000, 200 * MS)
    grown = random_events(seed + 50, 30_000, 500 * MS, (10, 190, 5, 90), int(still["t"][-1]))
    events = np.concatenate([still, grown])
    whole = pyramid_of([events]).levels()
    pieces = pyramid_of(np.split(events, np.sort(rng.integers(0, len(events), 40)))).levels()
    assert len(whole) == len(pieces)
    for a, b in zip(whole, pieces, strict=True):
        assert (a.t0, a.bin, a.cell) == (b.t0, b.bin, b.cell)
        assert np.array_equal(a.counts, b.counts)
        assert np.array_equal(a.valid, b.valid)


def test_a_fine_level_keeps_the_window_with_the_most_events():
    quiet = random_events(1, 4000, 2000 * MS, start=0)
    busy = random_events(2, 20_000, 50 * MS, start=2000 * MS)
    after = random_events(3, 4000, 2000 * MS, start=2050 * MS)
    finest = pyramid_of(np.array_split(np.concatenate([quiet, busy, after]), 50)).levels()[1]
    middle = finest.t0 + finest.bin * len(finest.counts) // 2
    assert 2000 * MS < middle < 2070 * MS


def test_memory_does_not_grow_with_the_stream():
    sizes = []
    for seconds in (20, 200):
        pyramid = pyramid_of(np.array_split(random_events(4, 40_000, seconds * 1000 * MS, start=0), 100))
        sizes.append(pyramid.nbytes)
        assert all(len(level.counts) <= WINDOW for level in pyramid.levels())
        covers = [level for level in pyramid.levels() if level.bin * WINDOW > seconds * 1000 * MS]
        assert all(level.counts.sum(dtype=int) == pytest.approx(40_000, rel=0.06) for level in covers[:3])
    assert max(sizes) < 60e6


def test_lost_packets_are_missing_bins_and_partly_seen_ones_are_scaled():
    events = random_events(5, 50_000, 1000 * MS, start=0)
    begin, end = 299 * MS, 415 * MS
    counter, pyramid = PyramidCounter(*SIZE), ActivityPyramid()
    counter.add(events[events["t"] < begin])
    counter.miss(begin, end)
    counter.add(events[events["t"] >= end])
    counter.finish()
    pyramid.add(counter.take())
    level = next(level for level in pyramid.levels() if level.bin == 16_384_000)
    edges = level.t0 + level.bin * np.arange(len(level.counts) + 1)
    hidden = np.clip(np.minimum(edges[1:], end) - np.maximum(edges[:-1], begin), 0, None) / level.bin
    assert np.array_equal(level.valid[1:-1], hidden[1:-1] <= 0.5)
    total = level.counts.sum(axis=(1, 2, 3))
    assert total[level.valid][1:-1] == pytest.approx(np.full(level.valid.sum() - 2, 50 * 16.384), rel=0.25)
    assert ((hidden > 0) & (hidden < 0.5)).any()


def test_an_object_of_40_px_has_ten_cells_in_any_sensor():
    events = random_events(6, FIRST_EVENTS, MS, (900, 940, 400, 440))
    level = pyramid_of([events], (1280, 720)).levels()[0]
    assert level.cell == 4
    assert max(level.counts.shape[2:]) in (11, 12, 13)


def test_the_region_grows_with_what_moves_and_nothing_coarse_is_lost():
    small = random_events(7, 4000, 100 * MS, (60, 80, 20, 40), 0)
    large = random_events(8, 100_000, 900 * MS, (15, 185, 8, 92), 100 * MS)
    level = next(a for a in pyramid_of(np.array_split(np.concatenate([small, large]), 20)).levels() if a.bin > 4 * MS)
    assert level.counts[:24].sum(dtype=int) == pytest.approx(4000, rel=0.05)
    assert level.counts.shape[3] * level.cell >= 168
    assert max(level.counts.shape[2:]) <= 14


def test_few_events_are_counted_at_the_end():
    levels = pyramid_of([random_events(9, 50, 100 * MS)]).levels()
    assert levels[6].counts.sum(dtype=int) > 40


def test_moved_counts_are_those_of_the_same_pixels():
    events = random_events(10, 3000, 10, (30, 100, 20, 60), 0)
    old, other = Region(4, 4, 7, 12, 20), Region(8, 0, 0, 13, 25)
    new = union(old, other)
    fine = Activity(0, 10, 4, np.zeros((1, 2, 12, 20), np.uint16))
    counts = plain_counts(events, fine, old).astype(np.uint16)
    coarse = Activity(0, 10, new.cell, np.zeros((1, 2, new.rows, new.columns), np.uint16))
    inside = (events["y"] >= 16) & (events["y"] < 64) & (events["x"] >= 28) & (events["x"] < 108)
    assert np.array_equal(moved(counts, old, new), plain_counts(events[inside], coarse, new))


def test_bins_of_no_level_are_an_error():
    with pytest.raises(ActivityError, match="bins of 5000000 ns are none of a pyramid"):
        ActivityPyramid().add([Activity(0, 5 * MS, 4, np.zeros((1, 2, 3, 3), np.uint16))])
    with pytest.raises(ActivityError, match="not aligned"):
        ActivityPyramid().add([Activity(7, BINS[2], 4, np.zeros((1, 2, 3, 3), np.uint16))])


def test_cells_that_a_growing_region_takes_in_were_not_dark():
    """Noise everywhere, and an object that is seen on the left first, then on the right."""
    noise = random_events(11, 40_000, 4000 * MS, (0, 200, 0, 100), 0)
    left = random_events(12, 20_000, 2000 * MS, (20, 60, 20, 60), 0)
    right = random_events(13, 80_000, 2000 * MS, (100, 160, 20, 60), 2000 * MS)
    events = np.concatenate([noise, left, right])
    events = events[np.argsort(events["t"], kind="stable")]
    level = next(a for a in pyramid_of(np.array_split(events, 30)).levels() if a.bin > 60 * MS)
    far = level.counts[:, :, :, -2:].sum(axis=(1, 2, 3), dtype=int)
    assert level.counts.shape[3] * level.cell > 130
    share = 2 * level.cell**2 * level.counts.shape[2] / (SIZE[0] * SIZE[1])
    assert far[1:25].mean() == pytest.approx(40_000 / 4000 * level.bin / MS * share, rel=0.4)
