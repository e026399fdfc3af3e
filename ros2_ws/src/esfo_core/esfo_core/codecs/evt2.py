"""The `evt2` encoding of Prophesee sensors: 32-bit little-endian words (Prophesee EVT 2.0).

Bits 28-31 are the type. An event has the low 6 bits of its time in bits 22-27, x in 11-21, y in 0-10. TIME_HIGH gives
the upper 28 bits of a 34-bit clock in microseconds, which wraps every 4.77 hours; the decoder counts the wraps.
One damaged TIME_HIGH gives a wrong time to the events up to the next one, and to no others.
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
    UNKNOWN,
    UNSYNCHRONISED,
    WIDTH,
    StateDecoder,
)
from esfo_core.codecs.wrapping_clock import CLOCK_SIZE, CURRENT, KNOWN, follow
from esfo_core.events import EVENT_DTYPE, EventArray

CD_OFF, CD_ON, TIME_HIGH, EXT_TRIGGER, OTHERS, CONTINUED = 0x0, 0x1, 0x8, 0xA, 0xE, 0xF

HIGH_PERIOD = 2**28
"""TIME_HIGH counts modulo this; one step is 64 us."""

HIGH_LIMIT = 625
"""Largest step of TIME_HIGH that is trusted at once, 40 ms: less than the jitter that readers sort in."""

CLOCK = HEAD
HIGH, SEEN = CLOCK + CURRENT, CLOCK + KNOWN


class Evt2Decoder(StateDecoder):
    """Decodes `evt2` data; times are those of the sensor's clock."""

    word = np.dtype("<u4")
    state_size = CLOCK_SIZE

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        kind = words >> 28
        events = np.empty(int(np.count_nonzero(kind <= CD_ON)), EVENT_DTYPE)
        triggers = np.empty(int(np.count_nonzero(kind == EXT_TRIGGER)), TRIGGER_DTYPE)
        n, k = _decode_words(words, self._state, events, triggers)
        self._count(triggers[:k])
        return events[:n]


@njit(cache=True, nogil=True)
def _decode_words(words, state, events, triggers):  # type: ignore[no-untyped-def]
    """Decode `words` (M,) with `state`, read and written; return the numbers of events and triggers."""
    n = k = 0
    for word in words:
        kind, value = word >> 28, np.int64(word & 0xFFFFFFF)
        t = (state[HIGH] * 64 + (value >> 22)) * 1000
        if kind == TIME_HIGH:
            set_time_high(value, state)
        elif kind in (CD_OFF, CD_ON, EXT_TRIGGER) and not state[SEEN]:
            state[UNSYNCHRONISED] += 1
        elif kind in (CD_OFF, CD_ON):
            x, y = (value >> 11) & 0x7FF, value & 0x7FF
            if x >= state[WIDTH] or y >= state[HEIGHT]:
                state[OUT_OF_RANGE] += 1
                continue
            events[n].x, events[n].y, events[n].p, events[n].t = x, y, kind, t
            n += 1
        elif kind == EXT_TRIGGER:
            triggers[k].t, triggers[k].edge, triggers[k].id = t, value & 1, (value >> 8) & 0x1F
            k += 1
        elif kind not in (OTHERS, CONTINUED):
            state[UNKNOWN] += 1
    return n, k


@njit(cache=True, nogil=True)
def set_time_high(value, state):  # type: ignore[no-untyped-def]
    """Take over the 28 bits of a TIME_HIGH word."""
    follow(value, HIGH_PERIOD, HIGH_PERIOD // 2, HIGH_LIMIT, state, CLOCK)
