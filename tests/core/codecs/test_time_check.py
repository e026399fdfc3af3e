"""Outliers of a clock are dropped, a clock that is set back and stays so is told, and nothing else is touched."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_core.codecs.time_check import ENOUGH_EVENTS, TimeCheck
from esfo_core.errors import RecordingError
from esfo_core.events import make_events

MS = 1_000_000
HOUR = 3600 * 1000 * MS


def stream(times):
    """Events in stream order, numbered by their x."""
    t = np.asarray(times, np.int64)
    return make_events(np.arange(len(t)), np.zeros(len(t)), np.zeros(len(t)), t)


def parts_of(events, size):
    """Packets of `size` events, cut and sorted as a decoder does it."""
    for start in range(0, len(events), size):
        part = events[start : start + size]
        latest, begin = part["t"][0], 0
        for i in range(1, len(part)):
            if latest - part["t"][i] > 50 * MS:
                yield np.sort(part[begin:i], order="t", kind="stable")
                begin, latest = i, part["t"][i]
            latest = max(latest, part["t"][i])
        yield np.sort(part[begin:], order="t", kind="stable")


def checked(events, size=7):
    """Segments of the events that pass, each in the order of their numbers, and how many were dropped."""
    check = TimeCheck()
    segments = [[]]
    passed = [pair for part in parts_of(events, size) for pair in check.push(part)] + list(check.flush())
    for part, anew in passed:
        if anew:
            segments.append([])
        segments[-1].append(part)
    return [np.sort(np.concatenate(s), order="x") for s in segments], check.outliers


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 300 * MS), st.integers(0, 45 * MS)), min_size=1, max_size=200), st.integers(1, 30)
)
def test_a_stream_with_pauses_and_jitter_passes_whole(steps, size):
    t = 10**12 + np.cumsum([step for step, _ in steps]) - [late for _, late in steps]
    events = stream(t)
    (segment,), outliers = checked(events, size)
    assert (segment == events).all()
    assert outliers == 0


@settings(max_examples=200, deadline=None)
@given(st.data(), st.integers(1, 30))
def test_single_events_at_wrong_times_are_all_that_is_lost(data, size):
    n = 400
    t = 10**13 + np.arange(n) * MS  # 0.4 s
    wrong = data.draw(st.lists(st.integers(1, n - ENOUGH_EVENTS), max_size=6, unique=True))
    for i in wrong:
        away = data.draw(st.integers(-(10**13), 10**13).filter(lambda d: abs(d) > 51 * MS))
        t[i] += away
    events = stream(t)
    (segment,), outliers = checked(events, size)
    assert segment["x"].tolist() == sorted(set(range(n)) - set(wrong))
    assert outliers == len(wrong)


@pytest.mark.parametrize("away", [-HOUR, HOUR, -80 * MS, 80 * MS])
def test_a_burst_of_one_damaged_word_is_dropped(away):
    t = HOUR * 2 + np.arange(30_000) * 5_000  # 200 events per ms
    t[10_000:10_800] += away  # 4 ms: the reach of one TIME_HIGH of EVT3
    (segment,), outliers = checked(stream(t), 500)
    assert len(segment) == 29_200
    assert outliers == 800


@pytest.mark.parametrize("back", [120 * MS, 250 * MS, HOUR])
def test_a_clock_that_stays_back_begins_a_segment(back):
    t = HOUR * 2 + np.arange(600) * MS
    t[300:] -= back
    events = stream(t)
    segments, outliers = checked(events)
    assert [s["x"].tolist() for s in segments] == [list(range(300)), list(range(300, 600))]
    assert outliers == 0


def test_a_clock_that_catches_up_is_one_segment_without_what_is_too_late():
    t = HOUR + np.arange(600) * MS
    t[300:] -= 70 * MS
    (segment,), outliers = checked(stream(t))
    assert segment["x"].tolist() == [*range(300), *range(300 + 20 - 1, 600)]
    assert outliers == 19


def test_the_end_of_a_stream():
    t = HOUR + np.arange(100) * MS
    ahead, _ = checked(stream([*t, 2 * HOUR]))
    assert [len(s) for s in ahead] == [101]  # a pause, for all that is known
    behind, dropped = checked(stream([*t, 5]))
    assert ([len(s) for s in behind], dropped) == ([100], 1)
    stays, dropped = checked(stream([*t, 5, 6]))
    assert ([len(s) for s in stays], dropped) == ([100, 2], 0)


def test_times_at_random_are_refused():
    t = np.random.default_rng(0).integers(0, 10**15, 20_000)
    with pytest.raises(RecordingError, match="contradict those around them"):
        checked(stream(t[::-1]))
