"""The events of the messages that came before `EventPacket`, as they lie in serialised messages.

An event is x and y (uint16), its time (seconds and nanoseconds, 32 bits each) and its polarity (one byte). ROS 1 packs
these into 13 bytes. CDR, the form of ROS 2, aligns each field to its size: as an event ends on its polarity, the next
begins one byte further, and from one event to the next all fields are 16 bytes apart, except that x and y of the first
event lie two bytes later than that, because the sequence begins on a multiple of 4.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from esfo_core.codecs.base import Decoder
from esfo_core.events import NS_PER_S, EventArray, empty_events, make_events

CDR_STRIDE = 16
ROS1_EVENT = np.dtype([("x", "<u2"), ("y", "<u2"), ("sec", "<u4"), ("nanosec", "<u4"), ("p", "u1")])

_CDR_PIXEL = np.dtype([("x", "<u2"), ("y", "<u2")])
_CDR_TIME = np.dtype([("sec", "<i4"), ("nanosec", "<u4"), ("p", "u1")])
_FIRST_TIME, _SECOND_PIXEL = 4, 14


def cdr_size(events: int) -> int:
    """Bytes of a CDR sequence of so many events, after its length."""
    return CDR_STRIDE * events - 3 if events else 0


class EventArrayDecoder(Decoder):
    """Base class for both forms; no state is kept between messages."""

    def _events(self, pixels: NDArray[Any], times: NDArray[Any]) -> EventArray:
        """Return events from the fields x, y of `pixels` (N,) and sec, nanosec, p of `times` (N,)."""
        t = times["sec"].astype(np.int64)
        t *= NS_PER_S
        t += times["nanosec"]
        if t.min(initial=0) < 0:
            possible = self._possible(t, np.iinfo(np.int64).max)
            pixels, times, t = pixels[possible], times[possible], t[possible]
        events = make_events(pixels["x"], pixels["y"], times["p"] != 0, t)
        inside = self._inside(events["x"], events["y"])
        return events if inside.all() else events[inside]


class CdrEventArrayDecoder(EventArrayDecoder):
    """Decodes the sequence of events of a message in CDR, little-endian, without its length."""

    word = np.dtype("u1")
    pixel: ClassVar[np.dtype[Any]] = _CDR_PIXEL
    time: ClassVar[np.dtype[Any]] = _CDR_TIME

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        count = (len(words) + 3) // CDR_STRIDE
        self.statistics.trailing_bytes += len(words) - cdr_size(count)
        if not count:
            return empty_events()
        pixels = np.empty(count, self.pixel)
        pixels[:1] = words[: self.pixel.itemsize].view(self.pixel)
        pixels[1:] = _strided(words, _SECOND_PIXEL, count - 1, self.pixel)
        return self._events(pixels, _strided(words, _FIRST_TIME, count, self.time))


class BigEndianCdrEventArrayDecoder(CdrEventArrayDecoder):
    """Decodes the same in big-endian order."""

    pixel = _CDR_PIXEL.newbyteorder(">")
    time = _CDR_TIME.newbyteorder(">")


class Ros1EventArrayDecoder(EventArrayDecoder):
    """Decodes the array of events of a ROS 1 message, without its length."""

    word = ROS1_EVENT

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        return self._events(words, words)


def _strided(data: NDArray[np.uint8], start: int, count: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """View fields that lie `CDR_STRIDE` bytes apart, without a copy."""
    return np.ndarray(count, dtype, data, start, (CDR_STRIDE,)) if count else np.empty(0, dtype)
