"""The DVS events of Event Stream files (`.es`, version 2): bytes that change a state.

The first byte of an event has its polarity in bit 0 and the us since the event before in bits 1-7; x and y follow with
two bytes each, little-endian. 0xFF adds 127 us, 0xFE does nothing. Rows count from the bottom in these files; they are
turned round here.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.codecs.state_machine import HEAD, HEIGHT, OUT_OF_RANGE, WIDTH, StateDecoder
from esfo_core.events import EVENT_DTYPE, EventArray

# How many bytes of an event have come, its polarity, the time so far in us, and its pixel.
STEP, POLARITY, TIME, X, Y = range(HEAD, HEAD + 5)

_OVERFLOW, _RESET, _OVERFLOW_US = 0xFF, 0xFE, 127
_EVENT_BYTES = 5


class EventStreamDecoder(StateDecoder):
    """Decodes the bytes after the header, in pieces cut anywhere."""

    word = np.dtype("u1")
    state_size = 5

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        events = np.empty(len(words) // _EVENT_BYTES + 1, EVENT_DTYPE)
        n = _decode_bytes(words, self._state, events)
        self._count(self.triggers)
        return events[:n]


@njit(cache=True, nogil=True)
def _decode_bytes(data, state, events):  # type: ignore[no-untyped-def]
    """Decode `data` (M,) with `state`, read and written; return the number of events."""
    n = 0
    for byte in data:
        value = np.int64(byte)
        step = state[STEP]
        if step == 0 and value == _OVERFLOW:
            state[TIME] += _OVERFLOW_US
        elif step == 0 and value == _RESET:
            continue
        elif step == 0:
            state[POLARITY], state[STEP] = value & 1, 1
            state[TIME] += value >> 1
        elif step == 1:
            state[X], state[STEP] = value, 2
        elif step == 2:
            state[X], state[STEP] = state[X] | value << 8, 3
        elif step == 3:
            state[Y], state[STEP] = value, 4
        else:
            y = state[Y] | value << 8
            state[STEP] = 0
            if state[X] >= state[WIDTH] or y >= state[HEIGHT]:
                state[OUT_OF_RANGE] += 1
                continue
            event = events[n]
            event.x, event.y, event.p, event.t = state[X], state[HEIGHT] - 1 - y, state[POLARITY], state[TIME] * 1000
            n += 1
    return n
