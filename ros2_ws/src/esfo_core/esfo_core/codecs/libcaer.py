"""The `libcaer` encoding of iniVation sensors: the polarity events of libcaer, 8 little-endian bytes each.

Word 0: bit 0 valid, bit 1 polarity, bits 2-16 y, bits 17-31 x. Word 1: time in microseconds, 31 bits, from the packet's
time base, which the driver advances when they roll over between packets.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from esfo_core.codecs.base import Decoder, check_time_base
from esfo_core.events import EventArray, make_events

ROLLOVER_US = 2**31


class LibcaerDecoder(Decoder):
    """Decodes `libcaer` packets; they carry no state from one to the next. Events marked invalid are no events."""

    word = np.dtype([("data", "<u4"), ("t", "<u4")])

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        check_time_base(time_base)
        data = words["data"]
        x, y = data >> 17, (data >> 2) & 0x7FFF
        t = _unrolled(words["t"]) * 1000 + time_base
        events = make_events(x, y, (data >> 1) & 1, t)
        kept = self._inside(x, y) & ((data & 1) == 1)
        return events if kept.all() else events[kept]


def _unrolled(low: NDArray[np.uint32]) -> NDArray[np.int64]:
    """Continue the 31-bit times (N,) of one packet over a rollover: a step back by more than half the range."""
    t = (low & 0x7FFFFFFF).astype(np.int64)
    rollovers = np.cumsum(np.diff(t, prepend=t[:1]) < -ROLLOVER_US // 2)
    return np.asarray(t + rollovers * ROLLOVER_US)
