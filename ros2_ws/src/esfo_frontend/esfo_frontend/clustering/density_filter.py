"""Density filter: corners of moving structure lie among more events of their polarity than chance corners do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from esfo_core.events import NS_PER_S, EventArray
from esfo_frontend.clustering.neighbour_counter import NeighbourCounter, neighbourhood
from esfo_frontend.options import DensityOptions


class DensityFilter:
    """Keeps the corners whose density score reaches the mean of their polarity (section 4.1, equation 2).

    D(e) = (1 / lambda) * number of events, corners or not, of the polarity of e within lambda of e. The paper gives
    no unit for that distance: it is taken in (x, y, scaled t) with the time scale of the other stages, and includes
    events after e, so that a corner is scored only when the stream is `reach` ns past it. The mean is over all corners
    of that polarity so far, those of the slice being filtered included, each weighted by exp(-age / memory).
    """

    def __init__(self, width: int, height: int, time_scale: float, options: DensityOptions) -> None:
        self._radius, self._memory = options.radius, options.memory
        self._counter = NeighbourCounter(width, height, neighbourhood(options.radius, time_scale))
        self.reach = self._counter.reach
        # With equal weights these stay integers: exact, whatever the order of the additions.
        self._sum = np.zeros(2)
        self._number = np.zeros(2)
        self._last_t: int | None = None

    @property
    def idle(self) -> bool:
        """True when no corner waits to be scored."""
        return self._counter.idle

    def add(self, events: EventArray, corner: NDArray[np.bool_]) -> None:
        """Take in events (N,) that follow the earlier ones, and the mask (N,) of the corners among them."""
        self._counter.add(events, corner)

    def filter_until(self, end: int) -> tuple[EventArray, int]:
        """Score the waiting corners before `end` ns; return those kept and how many were scored.

        All events before `end + reach` must have been added.
        """
        corners, count = self._counter.take(end)
        if not len(corners):
            return corners, 0
        mean = self._update_means(corners, count)
        return corners[count / self._radius >= mean[corners["p"]]], len(corners)

    def _update_means(self, corners: EventArray, count: NDArray[np.int64]) -> NDArray[np.float64]:
        """Take corners (N,) with their neighbour counts (N,) into the mean scores of the polarities (2,)."""
        # Ages are counted from the newest corner, which so has weight 1: a long pause does not make the sums vanish.
        last_t = int(corners["t"][-1])
        weight = self._weight(last_t - corners["t"])
        forgotten = self._weight(np.array([0 if self._last_t is None else last_t - self._last_t]))
        self._last_t = last_t
        self._sum = self._sum * forgotten + np.bincount(corners["p"], weight * count, 2)
        self._number = self._number * forgotten + np.bincount(corners["p"], weight, 2)
        seen = self._number > 0
        return np.divide(self._sum, self._number, out=np.zeros(2), where=seen) / self._radius

    def _weight(self, age: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the weights (N,) in the mean of corners of so many ns ago."""
        return np.ones(len(age)) if self._memory == 0 else np.exp(-age / (NS_PER_S * self._memory))
