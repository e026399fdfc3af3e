"""Event counts of the stream in space and time, given out bin by bin."""

from __future__ import annotations

import numpy as np

from esfo_core.activity import Activity
from esfo_core.events import NS_PER_S, EventArray, empty_events
from esfo_frontend.options import ActivityOptions, nanoseconds

LONGEST_FILLED_GAP = 60 * NS_PER_S
"""Pauses of the stream up to this many ns are filled with empty bins; across longer ones the activity is split."""


class ActivityCounter:
    """Counts events of one stream into bins aligned to `t0` ns."""

    def __init__(self, width: int, height: int, t0: int, options: ActivityOptions) -> None:
        self._t0, self._cell = t0, options.cell
        self._bin = nanoseconds(options.bin)
        self._grid = (-(-height // options.cell), -(-width // options.cell))
        self._pending: list[EventArray] = []
        self._first = 0
        self._runs: list[list[Activity]] = []

    @property
    def end(self) -> int:
        """Start of the first bin that is not complete, ns."""
        return self._t0 + self._first * self._bin

    def add(self, events: EventArray) -> int:
        """Take in events (N,) that follow the earlier ones; leave out those before `t0` and return their number."""
        early = int(np.searchsorted(events["t"], self._t0))
        events = events[early:]
        if not len(events):
            return early
        first, last = ((int(events["t"][i]) - self._t0) // self._bin for i in (0, -1))
        if first > self._first:
            self._complete(first)
        if last > self._first:
            complete = int(np.searchsorted(events["t"], self._t0 + last * self._bin))
            self._pending.append(events[:complete])
            self._complete(last)
            events = events[complete:]
        self._pending.append(events)
        return early

    def finish(self) -> None:
        """Complete the last bin although the stream may have ended within it."""
        if self._pending:
            self._complete(self._first + 1)

    def take(self) -> Activity | None:
        """Return the completed bins not returned before, up to the first pause longer than LONGEST_FILLED_GAP."""
        return Activity.concatenate(self._runs.pop(0)) if self._runs else None

    def _complete(self, stop: int) -> None:
        events = np.concatenate([empty_events(), *self._pending])
        self._pending = []
        if len(events):
            self._count(events)
        self._first = stop

    def _count(self, events: EventArray) -> None:
        """Count events (N,) of completed bins, without making bins for the pauses at either end."""
        first, last = ((int(events["t"][i]) - self._t0) // self._bin for i in (0, -1))
        start = self._t0 + first * self._bin
        piece = Activity.from_events(events, start, last - first + 1, self._bin, self._cell, self._grid)
        if self._runs and start - self._runs[-1][-1].end <= LONGEST_FILLED_GAP:
            self._runs[-1].append(piece)
        else:
            self._runs.append([piece])
