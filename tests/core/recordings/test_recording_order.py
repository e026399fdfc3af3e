"""Packets that overlap in time come out in order, in chunks of equal duration."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_core.errors import RecordingError
from esfo_core.events import make_events
from esfo_core.recordings.ordering import TimeOrder

MS = 1_000_000


def packet(times, first_x=0):
    t = np.sort(np.asarray(times, np.int64))
    return make_events(np.arange(first_x, first_x + len(t)), np.zeros(len(t)), np.zeros(len(t)), t)


def chunks_of(packets, duration):
    order = TimeOrder(duration)
    chunks = [chunk for p in packets for chunk in order.push(p)]
    return [*chunks, *order.flush()], order


@settings(max_examples=200, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, 40 * MS), st.lists(st.integers(0, 45 * MS), max_size=6)), min_size=1, max_size=12
    ),
    st.integers(1, 60 * MS),
)
def test_every_event_comes_out_once_in_order_and_in_its_chunk(spread, duration):
    start, packets = 10**9, []
    for advance, offsets in spread:
        packets.append(packet([start + o for o in offsets], first_x=100 * len(packets)))
        start += advance
    chunks, _ = chunks_of(packets, duration)
    together = np.concatenate(packets)
    expected = together[np.argsort(together["t"], kind="stable")]
    assert all(len(chunk) for chunk in chunks)
    if not len(expected):
        assert not chunks
        return
    assert (np.concatenate(chunks) == expected).all()
    numbers = (expected["t"] - expected["t"][0]) // duration
    assert [len(chunk) for chunk in chunks] == np.unique(numbers, return_counts=True)[1].tolist()


def test_steps_back_are_counted():
    chunks, order = chunks_of([packet([0, 10, 30]), packet([20, 30, 40]), packet([39, 41])], MS)
    assert chunks[0]["t"].tolist() == [0, 10, 20, 30, 30, 39, 40, 41]
    assert order.out_of_order == 2


def test_equal_times_keep_the_order_of_their_packets():
    chunks, _ = chunks_of([packet([0, 10], 0), packet([10, 20], 2), packet([5], 4)], MS)
    assert chunks[0]["x"].tolist() == [0, 4, 1, 2, 3]


def test_a_step_back_beyond_jitter_is_an_error():
    order = TimeOrder(MS)
    list(order.push(packet([200 * MS])))
    with pytest.raises(RecordingError, match=r"back by 0\.150000 s, to 50000000 ns"):
        list(order.push(packet([50 * MS])))


def test_a_long_gap_costs_nothing():
    chunks, _ = chunks_of([packet([0]), packet([3600 * 10**9 + 5])], 10)
    assert [c["t"].tolist() for c in chunks] == [[0], [3600 * 10**9 + 5]]


def test_memory_is_bounded():
    order = TimeOrder(10 * MS)
    waiting = 0
    for k in range(1000):
        list(order.push(packet(k * MS + np.arange(100) * 10_000)))
        waiting = max(waiting, sum(len(p) for p, _ in order._waiting))
    assert waiting <= 100 * (10 + 50 + 1)  # one chunk, the jitter, one packet


def test_a_duration_must_be_positive():
    with pytest.raises(ValueError, match="0 ns"):
        TimeOrder(0)
