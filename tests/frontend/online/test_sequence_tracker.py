"""Losses by sequence number, through reordering, repetition, restarts and the wrap of the count."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_frontend.online.sequence_tracker import MAX_GAP, MEMORY, WRAP, SequenceStep, SequenceTracker

NEXT, GAP, STALE, RESTART = SequenceStep


def feed(numbers):
    follower = SequenceTracker()
    return follower, [follower.take(number) for number in numbers]


@pytest.mark.parametrize(
    ("numbers", "lost", "restarts", "turns"),
    [
        ([5, 6, 7], 0, 0, [NEXT, NEXT, NEXT]),
        ([5, 6, 10, 11], 3, 0, [NEXT, NEXT, GAP, NEXT]),
        ([5, 7, 6, 8], 0, 0, [NEXT, GAP, STALE, NEXT]),
        ([5, 9, 6, 10], 2, 0, [NEXT, GAP, STALE, NEXT]),
        ([5, 5, 6], 0, 0, [NEXT, STALE, NEXT]),
        ([5, 6, 5, 7, 6, 8], 0, 0, [NEXT, NEXT, STALE, NEXT, STALE, NEXT]),
        ([1000, 1001, 0, 1, 2], 0, 1, [NEXT, NEXT, RESTART, NEXT, NEXT]),
        ([10, 11, 0, 1, 2], 0, 1, [NEXT, NEXT, STALE, RESTART, NEXT]),
        ([5, 5 + MAX_GAP], MAX_GAP - 1, 0, [NEXT, GAP]),
        ([5, 6 + MAX_GAP, 7 + MAX_GAP], 0, 1, [NEXT, RESTART, NEXT]),
        ([5, 10**18, 10**18 + 1], 0, 1, [NEXT, RESTART, NEXT]),
        ([WRAP - 2, WRAP - 1, 0, 1], 0, 0, [NEXT] * 4),
        ([WRAP - 2, 1, WRAP - 1, 2], 1, 0, [NEXT, GAP, STALE, NEXT]),
        ([None, 5, None, 7, 8], 0, 0, [NEXT] * 5),
        ([5, None, None, 9], 1, 0, [NEXT, NEXT, NEXT, GAP]),
        ([5, 5 + 10 * MEMORY, 6], 10 * MEMORY - 1, 1, [NEXT, GAP, RESTART]),
    ],
)
def test_known_sequences(numbers, lost, restarts, turns):
    follower, found = feed(numbers)
    assert (follower.lost, follower.restarts, found) == (lost, restarts, turns)


@settings(max_examples=200, deadline=None)
@given(
    st.integers(0, WRAP - 1),
    st.lists(st.sampled_from(["send", "lose", "twice", "swap", "spoil"]), min_size=2, max_size=200),
)
def test_what_the_network_did_is_what_is_counted(first, acts):
    """The twin counts by what was done to the packets, which the follower cannot see."""
    sent, lost, pending = [first], 0, 0
    number = first
    for act in acts:
        number += 1
        if act == "lose":
            pending += 1
            continue
        if act == "swap":
            sent += [(number + 1) % WRAP, number % WRAP]
            number += 1
        elif act == "spoil":
            sent.append(None if pending == 0 else number % WRAP)
        else:
            sent += [number % WRAP] * (2 if act == "twice" else 1)
        lost, pending = lost + pending, 0
    follower, turns = feed(sent)
    assert (follower.lost, follower.restarts) == (lost, 0)
    assert turns.count(STALE) == sum(act in ("twice", "swap") for act in acts)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.integers(0, WRAP - 1) | st.integers(0, 300), max_size=100))
def test_any_numbers_are_never_millions_lost(numbers):
    follower, turns = feed(numbers)
    assert 0 <= follower.lost <= MAX_GAP * turns.count(GAP)
    assert follower.restarts == turns.count(RESTART)
    assert len(follower._missing) < MEMORY


def test_a_pause_in_which_nobody_listened_is_no_loss():
    follower, _ = feed([5, 7])
    follower.forget()
    assert follower.take(500) is NEXT
    assert follower.lost == 1


@pytest.mark.parametrize("size", [3, MEMORY // 2, MEMORY, 3 * MEMORY])
def test_a_count_that_goes_round_is_followed_for_ever(size):
    follower, turns = feed(list(range(size)) * 4)
    assert follower.lost == 0
    assert follower.restarts == 3
    assert turns.count(STALE) == (3 if size <= MEMORY else 0)
