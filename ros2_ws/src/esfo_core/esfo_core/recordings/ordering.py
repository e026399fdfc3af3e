"""Packets in, chunks of equal duration out, in strict time order."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from esfo_core.codecs import MAX_STEP_BACK
from esfo_core.errors import RecordingError
from esfo_core.events import EVENT_DTYPE, NS_PER_S, EventArray


class TimeOrder:
    """Merges packets that overlap in time and cuts them at multiples of `duration_ns` after the first event.

    Events wait until one `MAX_STEP_BACK` later than the end of their chunk has come, so that none can be late: a
    packet that steps back further raises RecordingError, so `TimeCheck` comes first. Memory: one chunk and
    `MAX_STEP_BACK` of events.
    out_of_order: events earlier than one of an earlier packet, sorted in.
    """

    def __init__(self, duration_ns: int) -> None:
        if duration_ns <= 0:
            raise ValueError(f"chunk duration {duration_ns} ns is not positive")
        self.out_of_order = 0
        self._duration = duration_ns
        # In time order, none overlapping another; each with its times as one block, quick to search.
        self._waiting: deque[tuple[EventArray, NDArray[np.int64]]] = deque()
        self._end: int | None = None  # of the current chunk, ns

    def push(self, events: EventArray) -> Iterator[EventArray]:
        """Take the time-sorted events (N,) of the next packet; yield the chunks that are complete."""
        if not len(events):
            return
        self._merge(events)
        yield from self._cut(int(self._waiting[-1][1][-1]) - MAX_STEP_BACK)

    def flush(self) -> Iterator[EventArray]:
        """Yield what is left: no packet follows."""
        if self._waiting:
            yield from self._cut(int(self._waiting[-1][1][-1]) + self._duration)

    def _merge(self, events: EventArray) -> None:
        times = np.ascontiguousarray(events["t"])
        if self._waiting and self._waiting[-1][1][-1] > times[0]:
            latest = int(self._waiting[-1][1][-1])
            if latest - times[0] > MAX_STEP_BACK:
                raise RecordingError(f"time steps back by {(latest - times[0]) / NS_PER_S:.6f} s, to {times[0]} ns")
            self.out_of_order += int(np.searchsorted(times, latest))
            overlapping: list[EventArray] = []
            while self._waiting and self._waiting[-1][1][-1] > times[0]:
                overlapping.insert(0, self._waiting.pop()[0])
            events = _joined([*overlapping, events])
            events = events[np.argsort(events["t"], kind="stable")]
            times = np.ascontiguousarray(events["t"])
        self._waiting.append((events, times))

    def _cut(self, complete: int) -> Iterator[EventArray]:
        """Yield the chunks that end at or before the time `complete`."""
        while self._waiting:
            first = int(self._waiting[0][1][0])
            if first > complete:  # and one still earlier may come
                return
            if self._end is None:
                self._end = first + self._duration
            elif first >= self._end:  # nothing in this chunk: jump over the gap
                self._end += ((first - self._end) // self._duration + 1) * self._duration
            if self._end > complete:
                return
            yield self._take(self._end)
            self._end += self._duration

    def _take(self, end: int) -> EventArray:
        parts = []
        while self._waiting and self._waiting[0][1][0] < end:
            events, times = self._waiting.popleft()
            count = int(np.searchsorted(times, end))
            parts.append(events[:count])
            if count < len(events):
                self._waiting.appendleft((events[count:], times[count:]))
        return parts[0] if len(parts) == 1 else _joined(parts)


def _joined(parts: list[EventArray]) -> EventArray:
    """Concatenate as bytes: five times faster than NumPy does it field by field."""
    return np.concatenate([np.ascontiguousarray(part).view(np.uint8) for part in parts]).view(EVENT_DTYPE)
