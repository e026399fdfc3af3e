"""The `evt3` encoding of Prophesee sensors: 16-bit little-endian words that change a state (Prophesee EVT 3.0).

The upper 4 bits are the code, the lower 12 its value. Times are microseconds of a 24-bit clock that wraps every
16.777 s; the decoder counts the wraps, so that its times go on. One damaged TIME_HIGH gives a wrong time to the events
up to the next one, and to no others.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.codecs.base import TRIGGER_DTYPE
from esfo_core.codecs.state_machine import (
    HEAD,
    HEIGHT,
    OUT_OF_RANGE,
    SEEN,
    UNKNOWN,
    UNSYNCHRONISED,
    WIDTH,
    StateDecoder,
)
from esfo_core.codecs.wrapping_clock import CLOCK_SIZE, CONFIRMED, CURRENT, KNOWN, NOTHING, TRUSTED, follow
from esfo_core.events import EVENT_DTYPE, EventArray

ADDR_Y, ADDR_X, VECT_BASE_X, VECT_12, VECT_8, TIME_LOW, CONTINUED_4 = 0x0, 0x2, 0x3, 0x4, 0x5, 0x6, 0x7
TIME_HIGH, EXT_TRIGGER, OTHERS, CONTINUED_12 = 0x8, 0xA, 0xE, 0xF

HIGH_PERIOD = 4096
"""TIME_HIGH counts modulo this; one step is 4096 us."""

HIGH_NS = 4_096_000
"""One step of TIME_HIGH, ns."""

HIGH_NOISE = 10
"""TIME_HIGH sometimes repeats a value up to this many steps old; further back, it has wrapped, or is damaged."""

# Time: TIME_HIGH with its wraps (of the clock), TIME_LOW, and both together in ns. Address: row, next column of vectors
# and their polarity.
CLOCK = HEAD
HIGH = CLOCK + CURRENT
LOW, T, Y, BASE, POLARITY = range(CLOCK + CLOCK_SIZE, CLOCK + CLOCK_SIZE + 5)

# What has been seen since the last loss.
SEEN_HIGH, SEEN_TIME, SEEN_Y, SEEN_BASE = 1, 2, 4, 8


class Evt3Decoder(StateDecoder):
    """Decodes `evt3` packets; times are those of the sensor's clock.

    Drivers leave the time base of a packet open. Only where that of the first packet equals the time of its first two
    words, but for the wraps of the clock, it counts: as `Evt3Encoder` writes it, it tells the wraps before the packet.
    """

    word = np.dtype("<u2")
    state_size = CLOCK_SIZE + 5

    def resynchronise(self) -> None:
        """Wait for address and time anew; the latest time stays, to count wraps from."""
        self._state[SEEN] = 0

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        if self._state[CLOCK + KNOWN] == NOTHING and _states_time(words, time_base):
            self._state[[HIGH, CLOCK + TRUSTED, CLOCK + KNOWN]] = time_base // HIGH_NS, time_base // HIGH_NS, CONFIRMED
        most_events, most_triggers = _room(words, _EVENTS_IN_WORD)
        # One more than can come out: the kernel writes every bit of a vector, and only bits that are set count.
        events = np.empty(most_events + 1, EVENT_DTYPE)
        triggers = np.empty(most_triggers, TRIGGER_DTYPE)
        n, k = _decode_words(words, self._state, events, triggers)
        self._count(triggers[:k])
        return events[:n]


def _states_time(words: NDArray[np.uint16], time_base: int) -> bool:
    """Whether the words (M,) begin with TIME_HIGH and TIME_LOW of the time `time_base` ns."""
    if len(words) < 2 or not 0 <= time_base < 2**62 or time_base % 1000:
        return False
    time = time_base // 1000
    return bool(words[0] == TIME_HIGH << 12 | time >> 12 & 0xFFF and words[1] == TIME_LOW << 12 | time & 0xFFF)


def _count_events() -> NDArray[np.uint8]:
    """Table (65536,): how many events a word can emit."""
    words = np.arange(1 << 16, dtype=np.uint16)
    code = words >> 12
    vectors = np.where(code == VECT_12, words & 0xFFF, np.where(code == VECT_8, words & 0xFF, code == ADDR_X))
    return np.asarray(np.bitwise_count(vectors), np.uint8)


_EVENTS_IN_WORD = _count_events()


@njit(cache=True, nogil=True)
def _room(words, events_in_word):  # type: ignore[no-untyped-def]
    """Return how many events and triggers `words` (M,) can emit."""
    n = k = 0
    for word in words:
        n += events_in_word[word]
        k += word >> 12 == EXT_TRIGGER
    return n, k


@njit(cache=True, nogil=True)
def _decode_words(words, state, events, triggers):  # type: ignore[no-untyped-def]
    """Decode `words` (M,) with `state`, read and written; return the numbers of events and triggers."""
    n = k = 0
    for word in words:
        code, value = word >> 12, np.int64(word & 0xFFF)
        if code == ADDR_X:
            n = _emit(np.int64(1), 1, value & 0x7FF, value >> 11, state, events, n)
        elif code in (VECT_12, VECT_8):
            size = 12 if code == VECT_12 else 8
            bits = value & ((1 << size) - 1)
            n = _emit(bits, size, state[BASE], state[POLARITY], state, events, n)
            state[BASE] += size
        elif code == EXT_TRIGGER:
            if state[SEEN] & SEEN_TIME:
                triggers[k].t, triggers[k].edge, triggers[k].id = state[T], value & 1, value >> 8
                k += 1
            else:
                state[UNSYNCHRONISED] += 1
        elif code not in (OTHERS, CONTINUED_4, CONTINUED_12):
            _change(code, value, state)
    return n, k


@njit(cache=True, nogil=True)
def _emit(bits, size, x, p, state, events, n):  # type: ignore[no-untyped-def]
    """Write an event for each of the `size` `bits` that is set, from column `x` on; return the new number of events."""
    y, t = state[Y], state[T]
    needed = SEEN_TIME | SEEN_Y if size == 1 else SEEN_TIME | SEEN_Y | SEEN_BASE
    if state[SEEN] & needed != needed:
        state[UNSYNCHRONISED] += _ones(bits)
        return n
    if y >= state[HEIGHT] or x + size > state[WIDTH]:
        inside = bits & ((1 << max(0, state[WIDTH] - x)) - 1) if y < state[HEIGHT] else 0
        state[OUT_OF_RANGE] += _ones(bits) - _ones(inside)
        bits = inside
    while bits:
        event = events[n]
        event.x, event.y, event.p, event.t = x, y, p, t
        n += bits & 1
        bits >>= 1
        x += 1
    return n


@njit(cache=True, nogil=True)
def _change(code, value, state):  # type: ignore[no-untyped-def]
    """Apply a word that emits nothing to `state`."""
    if code == ADDR_Y:
        state[Y] = value & 0x7FF
        state[SEEN] |= SEEN_Y
    elif code == VECT_BASE_X:
        state[BASE], state[POLARITY] = value & 0x7FF, value >> 11
        state[SEEN] |= SEEN_BASE
    elif code == TIME_LOW:
        state[LOW] = value
        state[T] = (state[HIGH] * 4096 + value) * 1000
        if state[SEEN] & SEEN_HIGH:
            state[SEEN] |= SEEN_TIME
    elif code == TIME_HIGH:
        follow(value, HIGH_PERIOD, HIGH_NOISE, HIGH_NOISE, state, CLOCK)
        state[T] = (state[HIGH] * 4096 + state[LOW]) * 1000
        state[SEEN] |= SEEN_HIGH
    else:
        state[UNKNOWN] += 1


@njit(cache=True, nogil=True)
def _ones(bits):  # type: ignore[no-untyped-def]
    """Count the bits that are set."""
    count = 0
    while bits:
        count += bits & 1
        bits >>= 1
    return count
