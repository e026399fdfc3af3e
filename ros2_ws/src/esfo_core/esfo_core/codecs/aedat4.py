"""The events of AEDAT4 files: 16 little-endian bytes each, as FlatBuffers lays out iniVation's `Event`.

Bytes 0-7 time in microseconds, 8-9 x, 10-11 y, 12 polarity, 13-15 nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from esfo_core.codecs.base import Decoder
from esfo_core.events import EventArray, make_events

_MAX_US = 2**62 // 1000


class Aedat4Decoder(Decoder):
    """Decodes the events of `aedat4` packets; they carry no state from one to the next."""

    word = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("on", "u1"), ("nothing", "V3")])

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        t = words["t"]
        if len(t) and not 0 <= t.min() <= t.max() <= _MAX_US:
            words = words[self._possible(t, _MAX_US)]
        events = make_events(words["x"], words["y"], words["on"] != 0, words["t"] * 1000)
        inside = self._inside(words["x"], words["y"])
        return events if inside.all() else events[inside]
