"""Activity comes out bin by bin, whatever the packets, and a pause costs no memory."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_core.activity import Activity
from esfo_core.events import make_events
from esfo_frontend.activity import LONGEST_FILLED_GAP, ActivityCounter
from esfo_frontend.options import ActivityOptions

MS = 1_000_000


def random_events(rng, n, duration):
    t = np.sort(rng.integers(0, duration, n))
    return make_events(rng.integers(0, 100, n), rng.integers(0, 70, n), rng.integers(0, 2, n), t)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 400), st.integers(1, 12))
def test_counts_equal_a_plain_loop_in_any_packets(seed, n, pieces):
    rng = np.random.default_rng(seed)
    events = random_events(rng, n, 60 * MS)
    t0 = int(events["t"][0])
    counter = ActivityCounter(100, 70, t0, ActivityOptions())
    taken = []
    for piece in np.split(events, np.sort(rng.integers(0, n + 1, pieces))):
        assert counter.add(piece) == 0
        taken.append(counter.take())
    counter.finish()
    taken.append(counter.take())
    assert counter.take() is None
    whole = Activity.concatenate(a for a in taken if a is not None)
    expected = np.zeros((int(events["t"][-1] - t0) // (5 * MS) + 1, 2, 3, 4), int)
    for x, y, p, t in events.tolist():
        expected[(t - t0) // (5 * MS), p, y // 32, x // 32] += 1
    assert whole.t0 == t0
    assert np.array_equal(whole.counts, expected)


def test_counts_saturate():
    n = 70_000
    counter = ActivityCounter(32, 32, 0, ActivityOptions())
    for t in (0, 1):
        counter.add(make_events(np.zeros(n), np.zeros(n), np.ones(n), np.full(n, t)))
    counter.finish()
    activity = counter.take()
    assert activity.counts.tolist() == [[[[0]], [[65535]]]]


def test_long_pause_splits_the_activity():
    counter = ActivityCounter(32, 32, 0, ActivityOptions())
    pause = 1000 * LONGEST_FILLED_GAP
    for t in (0, 6 * MS, pause, pause + 6 * MS):
        counter.add(make_events(*np.array([[1], [1], [1], [t]])))
    before = counter.take()
    after = counter.take()
    assert (before.t0, len(before.counts)) == (0, 2)
    assert (after.t0, len(after.counts)) == (pause, 1)
    assert counter.end == pause + 5 * MS


def test_events_before_the_start_are_left_out_and_reported():
    counter = ActivityCounter(32, 32, 100, ActivityOptions())
    assert counter.add(make_events(*np.array([[1, 1, 1], [1, 1, 1], [1, 1, 1], [98, 99, 100]]))) == 2
    counter.finish()
    assert counter.take().counts.sum() == 1
