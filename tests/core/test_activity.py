"""Event counts in space and time, and the event array they are made of."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_core.activity import Activity, ActivityError
from esfo_core.errors import EsfoError
from esfo_core.events import EVENT_DTYPE, empty_events, make_events

CELL, GRID = 8, (3, 4)  # of a sensor of 30 x 20 pixels: the last row and column of cells are cut

event = st.tuples(st.integers(0, 29), st.integers(0, 19), st.integers(0, 1), st.integers(-500, 1500))


def pack(listed):
    x, y, p, t = np.array(listed, np.int64).reshape(-1, 4).T
    return make_events(x, y, p, t)


def slow_counts(listed, t0, bins, bin_ns):
    counts = np.zeros((bins, 2, *GRID), int)
    for x, y, p, t in listed:
        for b in range(bins):
            if t0 + b * bin_ns <= t < t0 + (b + 1) * bin_ns:
                counts[b, p, y // CELL, x // CELL] += 1
    return counts


def piece(t0, bins, value=1, bin_ns=10, cell=CELL, grid=GRID):
    return Activity(t0, bin_ns, cell, np.full((bins, 2, *grid), value, np.uint16))


@settings(deadline=None)  # a busy machine is no failure
@given(st.lists(event, max_size=60), st.integers(-300, 300), st.integers(1, 9), st.integers(1, 400))
def test_counts_are_those_of_the_slow_twin(listed, t0, bins, bin_ns):
    activity = Activity.from_events(pack(listed), t0, bins, bin_ns, CELL, GRID)
    assert activity.counts.dtype == np.uint16
    assert (activity.counts == slow_counts(listed, t0, bins, bin_ns)).all()
    assert (activity.t0, activity.bin, activity.cell, activity.end) == (t0, bin_ns, CELL, t0 + bins * bin_ns)


def test_times_of_today_in_nanoseconds_keep_their_bins():
    t0 = 1_700_000_000_123_456_789
    counts = Activity.from_events(pack([(0, 0, 1, t0 + 4), (0, 0, 1, t0 + 5), (0, 0, 1, t0 - 1)]), t0, 2, 5, CELL, GRID)
    assert counts.counts[:, 1, 0, 0].tolist() == [1, 1]


def test_counts_saturate():
    limit = 65535
    for n in (limit, limit + 1, 3 * limit):
        counts = Activity.from_events(np.repeat(pack([(9, 0, 1, 7)]), n), 0, 1, 10, CELL, GRID).counts
        assert counts[0, 1, 0, 1] == limit
        assert counts.sum(dtype=int) == limit


def test_no_events_no_counts():
    assert not Activity.from_events(empty_events(), 0, 3, 10, CELL, GRID).counts.any()


@pytest.mark.parametrize(("x", "y"), [(32, 0), (0, 24), (65535, 65535)])
def test_events_outside_the_grid_are_an_error_and_never_counted_elsewhere(x, y):
    with pytest.raises(ActivityError, match=f"x = {x}, y = {y} lies outside 4 x 3 cells of 8 px"):
        Activity.from_events(pack([(x, y, 0, 5)]), 0, 1, 10, CELL, GRID)


@settings(deadline=None)  # a busy machine is no failure
@given(st.lists(event, max_size=60), st.lists(st.integers(1, 5), min_size=1, max_size=6), st.randoms())
def test_pieces_join_to_the_whole(listed, lengths, random):
    events = pack(listed)
    starts = [0, *itertools.accumulate(lengths)]
    parts = [
        Activity.from_events(events, start * 100, bins, 100, CELL, GRID)
        for start, bins in zip(starts[:-1], lengths, strict=True)
    ]
    random.shuffle(parts)
    joined = Activity.concatenate(iter(parts))
    whole = Activity.from_events(events, 0, sum(lengths), 100, CELL, GRID)
    assert (joined.t0, joined.bin, joined.cell, joined.end) == (whole.t0, whole.bin, whole.cell, whole.end)
    assert joined.counts.dtype == np.uint16
    assert (joined.counts == whole.counts).all()


def test_bins_of_a_gap_are_missing():
    joined = Activity.concatenate([piece(1050, 1, 3), piece(1000, 2, 7)])
    assert joined.t0 == 1000
    assert joined.counts[:, 0, 0, 0].tolist() == [7, 7, 0, 0, 0, 3]
    assert joined.valid.tolist() == [True, True, False, False, False, True]
    again = Activity.concatenate([piece(980, 1, 1), joined])
    assert again.valid.tolist() == [True, False, True, True, False, False, False, True]


def test_a_part_has_its_own_time_and_mask():
    joined = Activity.concatenate([piece(1050, 1, 3), piece(1000, 2, 7)])
    for start, stop, t0 in ((1, 4, 1010), (-2, None, 1040), (0, -1, 1000)):
        part = joined.part(start, stop)
        assert part.t0 == t0
        assert part.counts[:, 0, 0, 0].tolist() == joined.counts[start:stop, 0, 0, 0].tolist()
        assert part.valid.tolist() == joined.valid[start:stop].tolist()


def test_a_mask_of_another_length_is_an_error():
    with pytest.raises(ActivityError, match="mask of 2 does not fit 3 bins"):
        Activity(0, 10, CELL, np.zeros((3, 2, *GRID), np.uint16), np.ones(2, bool))


@pytest.mark.parametrize(
    "parts",
    [
        [piece(0, 3), piece(20, 3)],
        [piece(0, 3), piece(0, 3)],
        [piece(0, 9), piece(20, 1)],  # one within the other
        [piece(0, 9), piece(20, 1), piece(90, 1)],
        [piece(0, 2), piece(25, 1)],  # off the bins
    ],
)
def test_overlap_and_misalignment_are_errors(parts):
    for order in itertools.permutations(parts):
        with pytest.raises(ActivityError, match=r"overlaps or is not aligned with bins of 10 ns"):
            Activity.concatenate(order)


@pytest.mark.parametrize(
    "other", [piece(30, 1, bin_ns=5), piece(30, 1, cell=16), piece(30, 1, grid=(4, 3)), piece(30, 1, grid=(3, 5))]
)
def test_pieces_of_another_form_are_an_error(other):
    with pytest.raises(ActivityError, match="does not fit"):
        Activity.concatenate([piece(0, 3), other])


def test_nothing_to_join_is_an_error():
    with pytest.raises(ActivityError, match="no activity"):
        Activity.concatenate([])
    assert issubclass(ActivityError, EsfoError)


def test_events_are_packed_as_the_contract_says():
    events = make_events(np.array([1279, 0]), np.array([719, 1]), np.array([True, False]), np.array([2**62, -1]))
    assert events.dtype == EVENT_DTYPE
    assert EVENT_DTYPE.itemsize == 13
    assert events.tolist() == [(1279, 719, 1, 2**62), (0, 1, 0, -1)]
    assert (len(empty_events()), empty_events().dtype) == (0, EVENT_DTYPE)
