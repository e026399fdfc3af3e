"""The events of Prophesee DAT files: 8 little-endian bytes each.

Word 0: time in microseconds, 32 bits, which wraps every 71.6 minutes; the decoder counts the wraps. Word 1: x in bits
0-13, y in 14-27, polarity in 28-31. One damaged time is that of its own event only.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.codecs.base import Decoder
from esfo_core.codecs.wrapping_clock import CLOCK_SIZE, CONFIRMED, CURRENT, KNOWN, TRUSTED, follow
from esfo_core.events import EventArray, make_events

WRAP_US = 2**32

STEP_LIMIT_US = 40_000
"""Largest step of time that is trusted at once: less than the jitter that readers sort in."""


class DatDecoder(Decoder):
    """Decodes `dat` data; times are those of the sensor's clock."""

    word = np.dtype([("t", "<u4"), ("data", "<u4")])

    def __init__(self, width: int, height: int) -> None:
        super().__init__(width, height)
        self._clock = np.zeros(CLOCK_SIZE, np.int64)

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        if not len(words):
            return make_events(*[np.empty(0)] * 4)
        data = words["data"]
        x, y = data & 0x3FFF, (data >> 14) & 0x3FFF
        t = continued(words["t"], WRAP_US, self._clock)
        events = make_events(x, y, (data >> 28) & 1, t * 1000)
        inside = self._inside(x, y)
        return events if inside.all() else events[inside]


@njit(cache=True, nogil=True)
def continued(low, period, clock):  # type: ignore[no-untyped-def]
    """Continue the times `low` (N,) in us, which count modulo `period`, with the state `clock`; return them (N,)."""
    t = np.empty(len(low), np.int64)
    start, before = np.int64(0), np.int64(-period)  # of the latest wrap, and the latest value, where that is trusted
    for i in range(len(low)):
        value = np.int64(low[i])
        if before <= value <= before + STEP_LIMIT_US:  # nearly always
            before = value
            t[i] = start + value
            continue
        if before >= 0:
            clock[CURRENT] = clock[TRUSTED] = start + before
        follow(value, period, period // 2, STEP_LIMIT_US, clock, 0)
        t[i] = clock[CURRENT]
        trusted = clock[KNOWN] == CONFIRMED and clock[CURRENT] == clock[TRUSTED]
        start, before = t[i] - value, value if trusted else np.int64(-period)
    if before >= 0:
        clock[CURRENT] = clock[TRUSTED] = start + before
    return t
