"""The `libcaer_cmp` encoding of iniVation sensors: 16-bit little-endian words that change a state.

The upper 4 bits are the code, the lower 12 its value; vectors run down a column. Times are microseconds from the
packet's time base, 24 bits, zero at the start of each packet.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.codecs.base import check_time_base
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
from esfo_core.events import EVENT_DTYPE, EventArray

TIME_HIGH, TIME_LOW, ADDR_X, ADDR_Y, VECT_BASE_Y, VECT_8 = range(6)

# Time: the packet's base and the time after it, ns. Address: column, next row of vectors and their polarity.
TIME_BASE, HIGH, LOW, X, BASE, POLARITY = range(HEAD, HEAD + 6)

SEEN_X, SEEN_BASE = 1, 2


class LibcaerCmpDecoder(StateDecoder):
    """Decodes `libcaer_cmp` packets."""

    word = np.dtype("<u2")
    state_size = 6

    def resynchronise(self) -> None:
        """Forget the address."""
        self._state[SEEN] = 0

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        check_time_base(time_base)
        code = words >> 12
        most = int(np.count_nonzero(code == ADDR_Y)) + 8 * int(np.count_nonzero(code == VECT_8))
        events = np.empty(most, EVENT_DTYPE)
        self._state[[TIME_BASE, HIGH, LOW]] = time_base, 0, 0
        n = _decode_words(words, self._state, events)
        self._count(self.triggers)
        return events[:n]


@njit(cache=True, nogil=True)
def _decode_words(words, state, events):  # type: ignore[no-untyped-def]
    """Decode `words` (M,) with `state`, read and written, into `events`; return their number."""
    n = 0
    for word in words:
        code, value = word >> 12, np.int64(word & 0xFFF)
        if code == ADDR_Y:
            n = _emit(np.int64(1), value & 0x7FF, value >> 11, SEEN_X, state, events, n)
        elif code == VECT_8:
            n = _emit(value & 0xFF, state[BASE], state[POLARITY], SEEN_X | SEEN_BASE, state, events, n)
            state[BASE] += 8
        elif code == ADDR_X:
            state[X] = value & 0x7FF
            state[SEEN] |= SEEN_X
        elif code == TIME_LOW:
            state[LOW] = value
        elif code == TIME_HIGH:
            state[HIGH] = value
        elif code == VECT_BASE_Y:
            state[BASE], state[POLARITY] = value & 0x7FF, value >> 11
            state[SEEN] |= SEEN_BASE
        else:
            state[UNKNOWN] += 1
    return n


@njit(cache=True, nogil=True)
def _emit(bits, y, p, needed, state, events, n):  # type: ignore[no-untyped-def]
    """Write an event for each of the `bits` that is set, from row `y` on; return the new number of events."""
    x, t = state[X], state[TIME_BASE] + (state[HIGH] * 4096 + state[LOW]) * 1000
    while bits:
        if bits & 1:
            if state[SEEN] & needed != needed:
                state[UNSYNCHRONISED] += 1
            elif x >= state[WIDTH] or y >= state[HEIGHT]:
                state[OUT_OF_RANGE] += 1
            else:
                events[n].x, events[n].y, events[n].p, events[n].t = x, y, p, t
                n += 1
        bits >>= 1
        y += 1
    return n
