"""The `libcaer` encoding of iniVation sensors: the polarity events of libcaer, 8 little-endian bytes each.

Word 0: bit 0 valid, bit 1 polarity, bits 2-16 y, bits 17-31 x. Word 1: time in microseconds, 31 bits, from the packet's
time base, which the driver advances when they roll over between packets.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from esfo_core.codecs.base import Decoder, check_time_base
from esfo_core.codecs.dat import continued
from esfo_core.codecs.wrapping_clock import CLOCK_SIZE
from esfo_core.events import EventArray, make_events

ROLLOVER_US = 2**31


class LibcaerDecoder(Decoder):
    """Decodes `libcaer` packets; they carry no state from one to the next. Events marked invalid are no events."""

    word = np.dtype([("data", "<u4"), ("t", "<u4")])

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        check_time_base(time_base)
        data = words["data"]
        x, y = data >> 17, (data >> 2) & 0x7FFF
        low = (words["t"] & 0x7FFFFFFF).astype(np.int64)
        t = continued(low, ROLLOVER_US, np.zeros(CLOCK_SIZE, np.int64)) * 1000 + time_base
        events = make_events(x, y, (data >> 1) & 1, t)
        kept = self._inside(x, y) & ((data & 1) == 1)
        return events if kept.all() else events[kept]
