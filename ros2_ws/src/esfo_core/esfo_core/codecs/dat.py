"""The events of Prophesee DAT files: 8 little-endian bytes each.

Word 0: time in microseconds, 32 bits, which wraps every 71.6 minutes; the decoder counts the wraps. Word 1: x in bits
0-13, y in 14-27, polarity in 28-31.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from esfo_core.codecs.base import Decoder
from esfo_core.events import EventArray, make_events

WRAP_US = 2**32


class DatDecoder(Decoder):
    """Decodes `dat` data; times are those of the sensor's clock."""

    word = np.dtype([("t", "<u4"), ("data", "<u4")])

    def __init__(self, width: int, height: int) -> None:
        super().__init__(width, height)
        self._latest: int | None = None  # us, with wraps

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        if not len(words):
            return make_events(*[np.empty(0)] * 4)
        data = words["data"]
        x, y = data & 0x3FFF, (data >> 14) & 0x3FFF
        t = self._unwrapped(words["t"].astype(np.int64))
        events = make_events(x, y, (data >> 28) & 1, t * 1000)
        inside = self._inside(x, y)
        return events if inside.all() else events[inside]

    def _unwrapped(self, low: NDArray[np.int64]) -> NDArray[np.int64]:
        """Continue the times (N,) in us over wraps: steps back by more than half the range."""
        latest = int(low[0]) if self._latest is None else self._latest
        wraps = latest // WRAP_US + np.cumsum(np.diff(low, prepend=latest % WRAP_US) < -WRAP_US // 2)
        t = np.asarray(low + wraps * WRAP_US)
        self._latest = int(t[-1])
        return t
