"""Density filter: corners of moving structure lie among more events of their polarity than chance corners do."""

from __future__ import annotations

from fractions import Fraction
from math import isqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.events import EventArray, empty_events
from esfo_frontend.options import DensityOptions


def neighbourhood(radius: float, time_scale: float) -> NDArray[np.int64]:
    """Return the ball of `radius` px as (M, 3) rows (dx px, dy px, half ns).

    An event at that pixel offset is within `radius` when it is at most `half` nanoseconds away in time, with time
    counted as `time_scale` px/s. Computed in exact arithmetic, so no event is in or out by rounding.
    """
    r2, scale = Fraction(radius) ** 2, Fraction(time_scale) / 10**9
    reach = int(radius)
    rows = [
        (dx, dy, isqrt(int((r2 - dx * dx - dy * dy) / scale**2)))
        for dy in range(-reach, reach + 1)
        for dx in range(-reach, reach + 1)
        if dx * dx + dy * dy <= r2
    ]
    return np.array(rows, np.int64)


class DensityFilter:
    """Keeps the corners whose density score reaches the mean of their polarity (section 4.1, equation 2).

    D(e) = (1 / lambda) * number of events, corners or not, of the polarity of e within lambda of e. The paper gives
    no unit for that distance: it is taken in (x, y, scaled t) with the time scale of the other stages, and includes
    events after e, so that a corner is scored only when the stream is `reach` ns past it. The mean is over all corners
    of that polarity so far, those of the slice being filtered included.
    """

    def __init__(self, width: int, height: int, time_scale: float, options: DensityOptions) -> None:
        self._size = (width, height)
        self._radius = options.radius
        self._ball = neighbourhood(options.radius, time_scale)
        self.reach = int(self._ball[:, 2].max())
        self._events: list[EventArray] = []
        self._corners: list[EventArray] = []
        # Sums of neighbour counts stay integers: exact, whatever the order of the additions.
        self._sum = np.zeros(2, np.int64)
        self._number = np.zeros(2, np.int64)

    @property
    def idle(self) -> bool:
        """True when no corner waits to be scored."""
        return not any(len(c) for c in self._corners)

    def add(self, events: EventArray, corner: NDArray[np.bool_]) -> None:
        """Take in events (N,) that follow the earlier ones, and the mask (N,) of the corners among them."""
        self._events.append(events)
        self._corners.append(events[corner])

    def filter_until(self, end: int) -> tuple[EventArray, int]:
        """Score the waiting corners before `end` ns; return those kept and how many were scored.

        All events before `end + reach` must have been added.
        """
        events = np.concatenate([empty_events(), *self._events])
        corners = np.concatenate([empty_events(), *self._corners])
        n = int(np.searchsorted(corners["t"], end))
        self._corners = [corners[n:]]
        # What is kept must be a copy: a view would keep the whole past alive.
        self._events = [events[np.searchsorted(events["t"], end - self.reach) :].copy()]
        corners = corners[:n]
        count = count_neighbours(corners, events, self._ball, self._size)
        for polarity in (0, 1):
            same = corners["p"] == polarity
            self._sum[polarity] += count[same].sum()
            self._number[polarity] += same.sum()
        mean = self._sum / np.maximum(self._number, 1) / self._radius
        return corners[count / self._radius >= mean[corners["p"]]], n


def count_neighbours(
    corners: EventArray, events: EventArray, ball: NDArray[np.int64], size: tuple[int, int]
) -> NDArray[np.int64]:
    """Return (N,) how many of the `events` of its polarity lie in the `ball` about each corner.

    ball: as from `neighbourhood`. size: width and height in px. A corner that is itself an event counts itself.
    """
    width, height = size
    key = (events["p"].astype(np.int64) * height + events["y"]) * width + events["x"]
    first = np.zeros(2 * width * height + 1, np.int32)
    times = np.empty(len(events), np.int64)
    _sort_by_pixel(key, np.ascontiguousarray(events["t"]), first, times)
    x, y, p, t = (corners[name].astype(np.int64) for name in ("x", "y", "p", "t"))
    count = np.zeros(len(corners), np.int64)
    _count((x, y, p, t), (first, times), ball, size, count)
    return count


@njit(cache=True, nogil=True)
def _sort_by_pixel(key, t, first, times):  # type: ignore[no-untyped-def]
    """Counting sort: `times` gets t (N,) pixel by pixel, those of key k from row first[k] on to first[k + 1]."""
    for i in range(len(key)):
        first[key[i]] += 1
    total = 0
    for k in range(len(first)):
        total += first[k]
        first[k] = total
    for i in range(len(key) - 1, -1, -1):
        first[key[i]] -= 1
        times[first[key[i]]] = t[i]


@njit(cache=True, nogil=True)
def _count(corners, events, ball, size, count):  # type: ignore[no-untyped-def]
    """Count for each corner (columns x, y, polarity, t) the events that each pixel of the ball has within its half.

    events: `first` and `times` of `_sort_by_pixel`. The pixels of a row lie side by side in both, so that the few
    events of each, all of one slice, are read from the cache faster than the right ones can be searched for.
    """
    x, y, p, t = corners
    first, times = events
    width, height = size
    for i in range(len(t)):
        inside = 0
        for j in range(len(ball)):
            column, row, half = x[i] + ball[j, 0], y[i] + ball[j, 1], ball[j, 2]
            if column < 0 or column >= width or row < 0 or row >= height:
                continue
            key = (p[i] * height + row) * width + column
            for k in range(first[key], first[key + 1]):
                inside += abs(times[k] - t[i]) <= half
        count[i] = inside
