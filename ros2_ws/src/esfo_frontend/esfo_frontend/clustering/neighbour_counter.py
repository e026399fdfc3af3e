"""Counts of the events around each corner, kept up with a stream."""

from __future__ import annotations

from fractions import Fraction
from math import isqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.events import EventArray, empty_events

_CELL = 8
"""Pixels of a row whose events are kept together: narrower cells cost more to index, wider ones to look through."""

_BATCH = 1 << 16
"""Events from which on indexing all cells of a sensor costs little for each of them."""


def neighbourhood(radius: float, time_scale: float) -> NDArray[np.int64]:
    """Return the ball of `radius` px as (2R + 1, 2R + 1) durations in ns by row dy + R and column dx + R.

    An event at that pixel offset is within `radius` when it is at most so far away in time, with time counted as
    `time_scale` px/s; -1 where no time is near enough. Computed in exact arithmetic, so no event is in or out by
    rounding.
    """
    r2, scale = Fraction(radius) ** 2, Fraction(time_scale) / 10**9
    reach = range(-int(radius), int(radius) + 1)
    rows = [[r2 - dx * dx - dy * dy for dx in reach] for dy in reach]
    return np.array([[isqrt(int(rest / scale**2)) if rest >= 0 else -1 for rest in row] for row in rows], np.int64)


class NeighbourCounter:
    """Counts for each corner the events of its polarity in a ball of (x, y, scaled t) around it, itself among them.

    Works in batches of the stream, each with the events up to the ball's duration before and after it. How the stream
    comes and where the batches end changes no count. At most three times that duration, or `_BATCH` events, are held
    beside those after the last call of `take`.
    """

    def __init__(self, width: int, height: int, ball: NDArray[np.int64]) -> None:
        """Prepare for a sensor of width x height px and a `ball` as from `neighbourhood`."""
        self.reach = int(ball.max())
        # Whole cells are looked through: columns beside the ball are not in it.
        self._ball = np.pad(ball, ((0, 0), (_CELL, _CELL)), constant_values=-1)
        self._first = np.empty((2, height, -(-width // _CELL) + 1), np.int32)
        self._events: list[EventArray] = []
        self._waiting: list[EventArray] = []
        self._counted: list[tuple[EventArray, NDArray[np.int64]]] = []
        self._new = 0
        self._begin: int | None = None

    @property
    def idle(self) -> bool:
        """True when no corner is left that `take` has not returned."""
        return not self._waiting and not self._counted

    def add(self, events: EventArray, corner: NDArray[np.bool_]) -> None:
        """Take in events (N,) that follow the earlier ones, and the mask (N,) of the corners among them."""
        if not len(events):
            return
        self._events.append(events)
        if corner.any():
            self._waiting.append(events[corner])
        self._new += len(events)
        if self._begin is None:
            self._begin = int(events["t"][0])
        end = int(events["t"][-1]) - self.reach
        if self._new >= _BATCH and end - self._begin >= self.reach:
            self._count(end)

    def take(self, end: int) -> tuple[EventArray, NDArray[np.int64]]:
        """Return the corners (N,) before `end` ns that have not been returned yet, with their counts (N,).

        All events before `end + reach` must have been added.
        """
        self._count(end)
        corners = np.concatenate([empty_events(), *(c for c, _ in self._counted)])
        counts = np.concatenate([np.empty(0, np.int64), *(n for _, n in self._counted)])
        n = int(np.searchsorted(corners["t"], end))
        self._counted = [(corners[n:].copy(), counts[n:].copy())] if n < len(corners) else []
        return corners[:n], counts[:n]

    def _count(self, end: int) -> None:
        """Count for the waiting corners before `end` ns, and forget the events that later ones do not need."""
        events = np.concatenate([empty_events(), *self._events])
        corners = np.concatenate([empty_events(), *self._waiting])
        n = int(np.searchsorted(corners["t"], end))
        if n:
            self._counted.append((corners[:n].copy(), self._counts(corners[:n], events)))
        self._waiting = [corners[n:].copy()] if n < len(corners) else []
        # What is kept must be a copy: a view would keep the whole past alive.
        self._events = [events[np.searchsorted(events["t"], end - self.reach) :].copy()]
        self._new = 0
        self._begin = end

    def _counts(self, corners: EventArray, events: EventArray) -> NDArray[np.int64]:
        near = np.searchsorted(events["t"], corners["t"][[0, -1]] + np.array([-self.reach, self.reach + 1]))
        events = events[near[0] : near[1]]
        column, time = np.empty(len(events), np.int32), np.empty(len(events), np.int64)
        _sort_into_cells(events, self._first, column, time)
        counts = np.empty(len(corners), np.int64)
        # Row by row, neighbours find each other's events in the cache.
        order = np.argsort(corners["y"], kind="stable")
        _count(corners, order, (self._first, column, time), self._ball, counts)
        return counts


@njit(cache=True, nogil=True)
def _sort_into_cells(events, first, column, time):  # type: ignore[no-untyped-def]
    """Counting sort of events (N,) by polarity, row and cell, in order of time within a cell, into `column` and `time`.

    first: (2, height, cells + 1); those of a cell c are the rows first[p, y, c] to first[p, y, c + 1] of both.
    """
    first[:] = 0
    for i in range(len(events)):
        event = events[i]
        first[event.p, event.y, event.x // _CELL] += 1
    total = 0
    flat = first.reshape(-1)
    for k in range(len(flat)):
        total += flat[k]
        flat[k] = total
    for i in range(len(events) - 1, -1, -1):
        event = events[i]
        at = first[event.p, event.y, event.x // _CELL] - 1
        first[event.p, event.y, event.x // _CELL] = at
        column[at], time[at] = event.x, event.t


@njit(cache=True, nogil=True)
def _count(corners, order, cells, ball, counts):  # type: ignore[no-untyped-def]
    """Count for each corner (N,) the events of its polarity in the `ball`, which has `_CELL` more columns at each side.

    order: (N,) in which to go through the corners; cells: `first`, `column` and `time` of `_sort_into_cells`. No branch
    depends on an event: a wrong guess would cost more than looking at the events too many.
    """
    first, column, time = cells
    height, last_cell = first.shape[1], first.shape[2] - 2
    reach, width = len(ball) // 2, ball.shape[1]
    durations = ball.reshape(-1)
    for i in order:
        p, x, y, t = corners[i].p, np.int64(corners[i].x), np.int64(corners[i].y), corners[i].t
        left, right = np.maximum(x - reach, 0) // _CELL, np.minimum((x + reach) // _CELL, last_cell)
        inside = 0
        for row in range(np.maximum(y - reach, 0), np.minimum(y + reach + 1, height)):
            # Unsigned, since Python's meaning of negative indices would double the time of the loop.
            at = np.uint64((row - y + reach) * width + width // 2 - x)
            for k in range(np.uint64(first[p, row, left]), np.uint64(first[p, row, right + 1])):
                inside += abs(time[k] - t) <= durations[at + np.uint64(column[k])]
        counts[i] = inside
