"""The `mono` encoding: one 64-bit little-endian word per event, times in nanoseconds from the packet's time base.

Bits 0-31 time, 32-47 x, 48-62 y, 63 polarity.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from esfo_core.codecs.base import Decoder, check_time_base
from esfo_core.errors import RecordingError
from esfo_core.events import EventArray, make_events

MAX_PACKET_DURATION = 2**32 - 1
"""Longest time from the time base that a word holds, ns."""

_MAX_ROW = 2**15 - 1


class MonoDecoder(Decoder):
    """Decodes `mono` packets; they carry no state from one to the next."""

    word = np.dtype("<u8")

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        check_time_base(time_base)
        x, y = (words >> np.uint64(32)) & np.uint64(0xFFFF), (words >> np.uint64(48)) & np.uint64(0x7FFF)
        t = (words & np.uint64(0xFFFFFFFF)).astype(np.int64) + time_base
        events = make_events(x, y, words >> np.uint64(63), t)
        inside = self._inside(x, y)
        return events if inside.all() else events[inside]


def encode_mono(events: EventArray, time_base: int) -> bytes:
    """Encode events (N,) as one `mono` packet, 8 bytes each, times relative to `time_base` ns.

    Raises RecordingError for an event before the time base, one more than `MAX_PACKET_DURATION` after it, and a row
    above 32767.
    """
    if not len(events):
        return b""
    elapsed = events["t"] - time_base
    if elapsed.min() < 0 or elapsed.max() > MAX_PACKET_DURATION:
        raise RecordingError(
            f"events from {elapsed.min()} to {elapsed.max()} ns after the time base {time_base} do not fit one packet "
            f"of {MAX_PACKET_DURATION} ns"
        )
    if events["y"].max() > _MAX_ROW:
        raise RecordingError(f"row {events['y'].max()} is above {_MAX_ROW}, the largest that `mono` holds")
    words = elapsed.astype(np.uint64)
    words |= events["x"].astype(np.uint64) << np.uint64(32)
    words |= events["y"].astype(np.uint64) << np.uint64(48)
    words |= (events["p"] != 0).astype(np.uint64) << np.uint64(63)
    return words.astype("<u8", copy=False).tobytes()
