"""Bounded memory: what is kept, what is forgotten, and that nothing is within the limits."""

import numpy as np
import pytest

from esfo_backend.online.stream_memory import StreamMemory, coarser
from esfo_backend.options import MemoryOptions
from esfo_core.activity import Activity, ActivityError
from esfo_core.tracks import Tracks, TrackUpdate

BIN = 5_000_000
NONE = TrackUpdate(Tracks.empty(), np.empty(0, np.uint32))
SMALL = MemoryOptions(max_bins=1000, max_observations=1000)


def pieces(bins, seed=0, begin=0, size=7):
    rng = np.random.default_rng(seed)
    counts = rng.poisson(3.0, (bins, 2, 2, 3)).astype(np.uint16)
    return [Activity(begin + k * BIN, BIN, 32, counts[k : k + size]) for k in range(0, bins, size)]


def tracks(ids, t, rows=4):
    track_id, times = np.repeat(ids, rows), np.repeat(t, rows) + np.tile(np.arange(rows), len(ids))
    return Tracks.from_columns(track_id, times, np.zeros((len(times), 2)), np.ones(len(times)))


def fed(memory, parts):
    for part in parts:
        memory.add(NONE, part)
    return memory


def test_within_the_limits_everything_is_kept():
    memory = fed(StreamMemory(SMALL), pieces(1000))
    rows = tracks(np.arange(250), np.arange(250))
    memory.add(TrackUpdate(rows, np.empty(0, np.uint32)), None)
    stream = memory.snapshot()
    whole = Activity.concatenate(pieces(1000))
    assert np.array_equal(stream.activity.counts, whole.counts)
    assert (stream.activity.t0, stream.activity.bin, stream.begin, stream.after_gap) == (0, BIN, 0, False)
    assert len(stream.tracks) == 1000
    assert np.array_equal(stream.tracks.track_id, rows.track_id)


def test_slow_turns_keep_all_time_in_coarser_bins():
    memory, every = StreamMemory(SMALL), pieces(9001, size=13)
    for k, part in enumerate(every):
        memory.add(NONE, part)
        assert memory.bins <= 1000 + 13
        stream = memory.snapshot()
        factor = stream.activity.bin // BIN
        whole = coarser(Activity.concatenate(every[: k + 1]), factor) if k % 50 == 0 or k == len(every) - 1 else None
        if whole is not None:  # every event is still counted, at its time
            assert stream.activity.t0 == 0
            assert np.array_equal(stream.activity.counts, whole.counts)
    assert factor == 16


def test_fast_turns_keep_the_latest_bins():
    memory = StreamMemory(SMALL)
    memory.rate_hz = 10.0
    every = pieces(5000)
    for part in every:
        memory.add(NONE, part)
        assert memory.bins <= 1000 + 7
    stream, whole = memory.snapshot(), Activity.concatenate(every)
    assert stream.activity.bin == BIN
    assert stream.activity.end == whole.end
    assert stream.begin == 0
    n = len(stream.activity.counts)
    assert n >= 750
    assert np.array_equal(stream.activity.counts, whole.counts[-n:])


def test_a_long_pause_drops_what_was_before():
    for options in (SMALL, MemoryOptions()):
        memory = fed(StreamMemory(options), pieces(3000))
        memory.add(TrackUpdate(tracks([1], [5]), np.empty(0, np.uint32)), None)
        later = 3000 * BIN + 61_000_000_000
        fed(memory, pieces(100, 1, later))
        memory.add(TrackUpdate(tracks([2], [later + 5]), np.empty(0, np.uint32)), None)
        stream = memory.snapshot()
        assert stream.after_gap
        assert stream.begin == stream.activity.t0 == later
        assert np.array_equal(stream.activity.counts, Activity.concatenate(pieces(100, 1, later)).counts)
        assert set(stream.tracks.track_id) == {2}


def test_a_short_pause_stays():
    memory = fed(StreamMemory(SMALL), pieces(1200))
    fed(memory, pieces(100, 1, 1300 * BIN))
    counts = memory.snapshot().activity.counts
    assert counts.shape[0] == 700
    assert counts[600:650].sum() == 0
    assert counts[650:].sum() == sum(int(p.counts.sum()) for p in pieces(100, 1))


def test_overlapping_activity_is_an_error_however_much_there_is():
    for bins in (50, 3000):
        memory = fed(StreamMemory(SMALL), pieces(bins))
        fed(memory, pieces(bins))
        with pytest.raises(ActivityError, match="overlaps"):
            memory.snapshot()
        assert memory.bins <= 1000 + 7


def test_tracks_are_bounded_and_those_that_recur_stay():
    memory = StreamMemory(SMALL)
    memory.reobserved = np.arange(0, 100, 10, dtype=np.uint32)
    for k in range(2000):
        memory.add(TrackUpdate(tracks([k], [k * BIN], 3 + k % 5), np.empty(0, np.uint32)), None)
        assert memory.rows <= 1000
    kept, rows = np.unique(memory.tracks().track_id, return_counts=True)
    assert set(memory.reobserved) <= set(kept)
    assert len(kept) > 80
    assert np.array_equal(rows, 3 + kept % 5)  # whole tracks
    assert kept[10:].min() < 400  # not the latest alone


def test_a_group_of_which_less_than_half_is_known_is_missing():
    valid = np.array([1, 1, 1, 0, 0, 0, 1, 0, 1], bool)
    grouped = coarser(Activity(0, BIN, 32, np.ones((9, 2, 1, 1), np.uint16), valid), 3)
    assert grouped.valid.tolist() == [True, False, True]
    assert grouped.counts[:, 0, 0, 0].tolist() == [3, 3, 3]


def test_bins_that_overflow_when_added_up_saturate():
    counts = np.full((4, 2, 1, 1), 40_000, np.uint16)
    counts[2:] = 20_000
    assert coarser(Activity(0, BIN, 32, counts), 2).counts[:, 0, 0, 0].tolist() == [65_535, 40_000]
