"""Event counts per pixel for figures: of a whole stream, and of one moment."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from esfo_core.events import EventArray, empty_events

LONGEST_MOMENT_NS = 100_000_000


class EventImage:
    """Counts the events of a stream per pixel and keeps those of a moment in its second quarter.

    The duration of the stream is not known in advance. Moments therefore begin after 1, 2, 4, ... times
    `LONGEST_MOMENT_NS`, and the last two are kept: the last but one begins after a quarter to a half of the stream so
    far. Memory does not grow with the stream.

    counts: (2, height, width) uint32 by polarity, all events.
    """

    def __init__(self, width: int, height: int) -> None:
        self.counts = np.zeros((2, height, width), np.uint32)
        self._first: int | None = None
        self._starts = (0, 0)
        self._moments: tuple[list[EventArray], list[EventArray]] = ([], [])

    def add(self, events: EventArray) -> None:
        """Count events (N,), sorted by time, which follow the earlier ones."""
        if not len(events):
            return
        np.add.at(self.counts.reshape(-1), self._flat(events), np.uint32(1))  # np.add.at is slower with a Python int
        if self._first is None:
            self._first = int(events["t"][0])
            self._starts = (self._first, self._first)
        while len(events):
            start = self._starts[1]
            following = start + max(start - self._first, LONGEST_MOMENT_NS)
            end, cut = np.searchsorted(events["t"], [start + LONGEST_MOMENT_NS, following])
            if end:
                self._moments[1].append(events[:end].copy())
            if cut < len(events):
                self._starts, self._moments = (start, following), (self._moments[1], [])
            events = events[cut:]

    def moment(self, duration_ns: int) -> EventArray:
        """Return the events (N,) of a moment of `duration_ns`, at most `LONGEST_MOMENT_NS`; N may be 0."""
        start, kept = (self._starts[0], self._moments[0]) if self._moments[0] else (self._starts[1], self._moments[1])
        events = np.concatenate([empty_events(), *kept])
        return events[: np.searchsorted(events["t"], start + duration_ns)]

    def count(self, events: EventArray) -> NDArray[np.uint32]:
        """Count other events (N,) of the same sensor per pixel, as `counts`."""
        counts = np.bincount(self._flat(events), minlength=self.counts.size)
        return counts.reshape(self.counts.shape).astype(np.uint32)

    def _flat(self, events: EventArray) -> NDArray[np.int64]:
        _, height, width = self.counts.shape
        return np.asarray((events["p"].astype(np.int64) * height + events["y"]) * width + events["x"])
