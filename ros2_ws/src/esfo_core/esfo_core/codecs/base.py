"""Base class of the decoders: input, counters, and output in time order."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.errors import RecordingError
from esfo_core.events import NS_PER_S, EventArray

Bytes: TypeAlias = bytes | bytearray | memoryview | NDArray[np.uint8]

TRIGGER_DTYPE = np.dtype([("t", "<i8"), ("edge", "i1"), ("id", "u1")])
"""One external trigger: sensor time t in nanoseconds, edge (0 falling, 1 rising), input number."""

MAX_STEP_BACK = 50_000_000
"""Largest step back in time (ns) that counts as jitter; a Prophesee clock repeats up to 41 ms around its high bits."""


@dataclass
class DecoderStatistics:
    """Counters of a decoder.

    events: events that came out. triggers_rising, triggers_falling: external triggers.
    out_of_range: events outside the sensor, dropped. unsynchronised: events before the first time stamp or address,
    dropped. unknown_words: words of no known code, skipped. out_of_order: events earlier than one before them in the
    same packet, sorted in. trailing_bytes: bytes at the end of packets that make no whole word, skipped. bad_lines:
    lines of text that are no events, skipped. impossible_times: events before zero or after all clocks, dropped.
    """

    events: int = 0
    triggers_rising: int = 0
    triggers_falling: int = 0
    out_of_range: int = 0
    unsynchronised: int = 0
    unknown_words: int = 0
    out_of_order: int = 0
    trailing_bytes: int = 0
    bad_lines: int = 0
    impossible_times: int = 0


class Decoder(ABC):
    """Turns the packets of one stream, in order, into events.

    width, height: sensor size in pixels; events outside are counted and dropped.
    statistics: counters since construction. triggers: (K,) of `TRIGGER_DTYPE`, those of the latest packet.
    """

    word: ClassVar[np.dtype[Any]]

    def __init__(self, width: int, height: int) -> None:
        if width <= 0 or height <= 0:
            raise RecordingError(f"sensor size {width}x{height} is not positive")
        self.width = width
        self.height = height
        self.statistics = DecoderStatistics()
        self.triggers: NDArray[np.void] = np.empty(0, TRIGGER_DTYPE)

    def decode(self, data: Bytes, time_base: int = 0) -> EventArray:
        """Decode one packet; the state of the stream survives to the next.

        data: the packet. time_base: that of its `EventPacket`, where the encoding uses it.
        Returns events (N,) in time order; within a packet, steps back of up to `MAX_STEP_BACK` are sorted and counted.
        Raises RecordingError for a larger step back or a time that does not fit 63 bits.
        """
        parts = self.decode_parts(data, time_base)
        if len(parts) > 1:
            back = (parts[0]["t"][-1] - parts[1]["t"][0]) / NS_PER_S
            raise RecordingError(f"time steps back by {back:.6f} s inside a packet")
        return parts[0]

    def decode_parts(self, data: Bytes, time_base: int = 0) -> list[EventArray]:
        """Decode one packet as `decode`, but cut it where time steps back by more than `MAX_STEP_BACK`.

        Returns at least one array of events (N,), each in time order.
        """
        raw = np.frombuffer(data, np.uint8)
        whole = len(raw) - len(raw) % self.word.itemsize
        self.statistics.trailing_bytes += len(raw) - whole
        parts = self._in_order(self._decode(raw[:whole].view(self.word), time_base))
        self.statistics.events += sum(len(part) for part in parts)
        return parts

    def resynchronise(self) -> None:  # noqa: B027 - encodings without state have nothing to forget
        """Packets are missing: emit nothing that depends on a word they may have held."""

    @abstractmethod
    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        """Decode whole words (M,) of the type `word` to events, in stream order."""

    def _in_order(self, events: EventArray) -> list[EventArray]:
        t = events["t"]
        if not (t[1:] < t[:-1]).any():
            return [events]
        parts = []
        for part in np.split(events, part_starts(t, MAX_STEP_BACK)):
            behind = np.maximum.accumulate(part["t"]) - part["t"]
            self.statistics.out_of_order += int(np.count_nonzero(behind))
            parts.append(part[np.argsort(part["t"], kind="stable")])
        return parts

    def _possible(self, t: NDArray[np.int64], latest: int) -> NDArray[np.bool_]:
        """Mask of the times t (N,) from 0 to `latest`, in any unit; counts the others.

        Raises RecordingError where most are impossible: then they are no damaged ones.
        """
        possible = (t >= 0) & (t <= latest)
        impossible = len(t) - int(np.count_nonzero(possible))
        if 2 * impossible > len(t):
            raise RecordingError(f"times from {t.min()} to {t.max()} are out of the range from 0 to {latest}")
        self.statistics.impossible_times += impossible
        return possible

    def _inside(self, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.bool_]:
        """Mask of the pixels on the sensor; counts the others."""
        inside = (x < self.width) & (y < self.height)
        self.statistics.out_of_range += len(inside) - int(np.count_nonzero(inside))
        return inside


@njit(cache=True, nogil=True)
def part_starts(t: NDArray[np.int64], limit: int) -> NDArray[np.int64]:
    """Indices into times t (N,) at which time has stepped back by more than `limit` from the latest of its part."""
    starts = np.empty(len(t), np.int64)
    n = 0
    latest = t[0]
    for i in range(1, len(t)):
        if latest - t[i] > limit:
            starts[n] = i
            n += 1
            latest = t[i]
        latest = max(latest, t[i])
    return starts[:n]


def check_time_base(time_base: int) -> None:
    """Raise RecordingError unless `time_base` ns leaves room for the times of a packet in 63 bits."""
    if not 0 <= time_base < 2**62:
        raise RecordingError(f"time base {time_base} ns is out of range")
