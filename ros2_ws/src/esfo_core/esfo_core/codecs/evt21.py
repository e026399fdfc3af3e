"""The `evt21` encoding of Prophesee sensors: 64-bit words (Prophesee EVT 2.1).

The upper half of a word is one of EVT2; the lower half of an event word has a bit for each of 32 pixels from x on.
`evt21_legacy` is the same with the halves in the other order, as the first cameras of this encoding wrote it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.codecs.base import TRIGGER_DTYPE
from esfo_core.codecs.evt2 import CD_OFF, CD_ON, CONTINUED, EXT_TRIGGER, HIGH, OTHERS, SEEN, TIME_HIGH, set_time_high
from esfo_core.codecs.state_machine import (
    HEIGHT,
    OUT_OF_RANGE,
    UNKNOWN,
    UNSYNCHRONISED,
    WIDTH,
    StateDecoder,
)
from esfo_core.codecs.wrapping_clock import CLOCK_SIZE
from esfo_core.events import EVENT_DTYPE, EventArray

VECTOR = 32
"""Pixels of one event word."""


class Evt21Decoder(StateDecoder):
    """Decodes `evt21` data; times are those of the sensor's clock."""

    word = np.dtype([("valid", "<u4"), ("event", "<u4")])
    state_size = CLOCK_SIZE

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        kind, valid = words["event"] >> 28, words["valid"]
        events = np.empty(int(np.bitwise_count(valid[kind <= CD_ON]).sum(dtype=np.int64)), EVENT_DTYPE)
        triggers = np.empty(int(np.count_nonzero(kind == EXT_TRIGGER)), TRIGGER_DTYPE)
        n, k = _decode_words(words["event"], valid, self._state, events, triggers)
        self._count(triggers[:k])
        return events[:n]


class Evt21LegacyDecoder(Evt21Decoder):
    """Decodes `evt21_legacy` data."""

    word = np.dtype([("event", "<u4"), ("valid", "<u4")])


@njit(cache=True, nogil=True)
def _decode_words(words, valid, state, events, triggers):  # type: ignore[no-untyped-def]  # noqa: C901 - one per code
    """Decode `words` and `valid` (M,) with `state`, read and written; return the numbers of events and triggers."""
    n = k = 0
    for i in range(len(words)):
        kind, value = words[i] >> 28, np.int64(words[i] & 0xFFFFFFF)
        t = (state[HIGH] * 64 + (value >> 22)) * 1000
        if kind == TIME_HIGH:
            set_time_high(value, state)
        elif kind in (CD_OFF, CD_ON):
            x, y = (value >> 11) & 0x7FF, value & 0x7FF
            for bit in range(VECTOR):
                if not (valid[i] >> bit) & 1:
                    continue
                if not state[SEEN]:
                    state[UNSYNCHRONISED] += 1
                elif x + bit >= state[WIDTH] or y >= state[HEIGHT]:
                    state[OUT_OF_RANGE] += 1
                else:
                    events[n].x, events[n].y, events[n].p, events[n].t = x + bit, y, kind, t
                    n += 1
        elif kind == EXT_TRIGGER and not state[SEEN]:
            state[UNSYNCHRONISED] += 1
        elif kind == EXT_TRIGGER:
            triggers[k].t, triggers[k].edge, triggers[k].id = t, value & 1, (value >> 8) & 0x1F
            k += 1
        elif kind not in (OTHERS, CONTINUED):
            state[UNKNOWN] += 1
    return n, k
