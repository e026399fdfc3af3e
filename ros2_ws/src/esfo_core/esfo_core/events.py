"""The event array that every stage consumes."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

EVENT_DTYPE = np.dtype([("x", "<u2"), ("y", "<u2"), ("p", "i1"), ("t", "<i8")])
"""One event: pixel column x, pixel row y, polarity p (0 off, 1 on), sensor time t in nanoseconds."""

EventArray: TypeAlias = NDArray[np.void]
"""Structured array (N,) of `EVENT_DTYPE`, sorted by time unless said otherwise."""

NS_PER_S = 1_000_000_000
"""Nanoseconds per second, an integer: times as whole nanoseconds stay exact."""


def empty_events() -> EventArray:
    """Return an event array of length zero."""
    return np.empty(0, EVENT_DTYPE)


def make_events(
    x: NDArray[np.generic], y: NDArray[np.generic], p: NDArray[np.generic], t: NDArray[np.generic]
) -> EventArray:
    """Pack four columns (N,) into one event array; x, y in pixels, p in {0, 1}, t in ns."""
    events = np.empty(len(t), EVENT_DTYPE)
    events["x"], events["y"], events["p"], events["t"] = x, y, p, t
    return events
