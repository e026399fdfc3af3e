"""The events of AEDAT 2.0 files, as jAER writes them: an address and a time in us, 32 bits each, big-endian.

jAER counts rows from the bottom, and columns from the right in addresses: both are turned round here. A word of a DAVIS
with bit 31 is no pixel event, one with bit 10 a trigger.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from esfo_core.codecs.base import Decoder
from esfo_core.codecs.dat import WRAP_US, continued
from esfo_core.codecs.wrapping_clock import CLOCK_SIZE
from esfo_core.events import EventArray, make_events

_NO_PIXEL = 1 << 31
_TRIGGER = 1 << 10


class Aedat2Decoder(Decoder):
    """What the chips share."""

    word = np.dtype([("address", ">u4"), ("t", ">u4")])

    def __init__(self, width: int, height: int) -> None:
        super().__init__(width, height)
        self._clock = np.zeros(CLOCK_SIZE, np.int64)

    def _made(self, x: NDArray[Any], y: NDArray[Any], p: NDArray[Any], t: NDArray[Any]) -> EventArray:
        """Events from addresses x, y, polarities and times (N,), jAER's axes turned to those of images."""
        inside = self._inside(x, y)
        low = t.astype(np.int64)[inside]
        times = continued(low, WRAP_US, self._clock) * 1000
        return make_events(self.width - 1 - x[inside], self.height - 1 - y[inside], p[inside], times)


class Dvs128Decoder(Aedat2Decoder):
    """Decodes the words of a DVS128: polarity in bit 0 (0: on), x in bits 1-7, y in bits 8-14, bit 15 a trigger."""

    trigger: ClassVar[int] = 1 << 15

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        words = words[words["address"] & self.trigger == 0]
        address = words["address"].astype(np.int64)
        return self._made((address >> 1) & 0x7F, (address >> 8) & 0x7F, 1 - (address & 1), words["t"])


class DavisDecoder(Aedat2Decoder):
    """Decodes the words of a DAVIS: polarity in bit 11 (1: on), x in bits 12-21, y in bits 22-30."""

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        words = words[words["address"] & (_NO_PIXEL | _TRIGGER) == 0]
        address = words["address"].astype(np.int64)
        return self._made((address >> 12) & 0x3FF, (address >> 22) & 0x1FF, (address >> 11) & 1, words["t"])
