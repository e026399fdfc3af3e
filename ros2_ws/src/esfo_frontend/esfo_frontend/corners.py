"""Corner events: eFAST on the surface of active events (Mueggler, Bartolozzi, Scaramuzza, BMVC 2017)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.events import EventArray
from esfo_frontend.options import CornerOptions

BORDER = 4
"""Pixels along the image edge where the outer circle does not fit: events there are never corners."""

INNER_CIRCLE = np.array(
    [
        [0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1],
        [3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1, 0, 1, 2, 3],
    ]
)
"""Offsets dx and dy of the 16 pixels at radius 3, in order around the circle, (2, 16)."""

OUTER_CIRCLE = np.array(
    [
        [0, 1, 2, 3, 4, 4, 4, 3, 2, 1, 0, -1, -2, -3, -4, -4, -4, -3, -2, -1],
        [4, 4, 3, 2, 1, 0, -1, -2, -3, -4, -4, -4, -3, -2, -1, 0, 1, 2, 3, 4],
    ]
)
"""Offsets dx and dy of the 20 pixels at radius 4, in order around the circle, (2, 20)."""

_NEVER = np.iinfo(np.int64).min


class CornerDetector:
    """Marks corner events; holds the surface of active events, so that a stream may come in any pieces.

    An event is a corner when on both circles the newest pixels form one arc of allowed length: every time on the arc
    is later than every time off it. Each polarity has its own surface. Pixels without an event yet count as older
    than all others, whatever the times of the stream.
    """

    def __init__(self, width: int, height: int, options: CornerOptions) -> None:
        self._surface = np.full((2, height, width), _NEVER, np.int64)
        self._inner = INNER_CIRCLE[1] * width + INNER_CIRCLE[0]
        self._outer = OUTER_CIRCLE[1] * width + OUTER_CIRCLE[0]
        self._lengths = np.array(
            [options.shortest_inner, options.longest_inner, options.shortest_outer, options.longest_outer]
        )

    def detect(self, events: EventArray) -> NDArray[np.bool_]:
        """Return a mask (N,) of the corner events among `events` (N,), which follow those of earlier calls."""
        columns = tuple(np.ascontiguousarray(events[name]) for name in ("x", "y", "p", "t"))
        corner = np.zeros(len(events), np.bool_)
        _detect(columns, self._surface, (self._inner, self._outer), self._lengths, corner)
        return corner


@njit(cache=True, nogil=True)
def _has_arc(ring, size, shortest, longest):  # type: ignore[no-untyped-def]
    """Return whether the newest values of ring[:size] form one arc of `shortest` to `longest` pixels.

    Such an arc holds the newest pixel, and as long as it is not complete the newer of the two pixels next to the part
    found so far belongs to it. So one arc per length has to be tested, not one per length and start.
    """
    newest = 0
    for i in range(1, size):
        if ring[i] > ring[newest]:
            newest = i
    left, right, oldest = newest, newest, ring[newest]
    for length in range(1, longest + 1):
        before = left - 1 if left > 0 else size - 1
        after = right + 1 if right < size - 1 else 0
        next_value = max(ring[before], ring[after])
        if length >= shortest and next_value < oldest:
            i, others = after, size - length
            while others > 0 and ring[i] < oldest:
                i = i + 1 if i < size - 1 else 0
                others -= 1
            if others == 0:
                return True
        if ring[before] == next_value:
            left = before
        else:
            right = after
        oldest = min(oldest, next_value)
    return False


@njit(cache=True, nogil=True)
def _detect(columns, surface, circles, lengths, corner):  # type: ignore[no-untyped-def]
    """Write the events into `surface` (2, height, width) one after the other and mark corners in `corner` (N,)."""
    height, width = surface.shape[1:]
    x, y, p, t = columns
    flat = surface.reshape(-1)
    inner, outer = circles
    ring = np.empty(len(outer), np.int64)
    for i in range(len(t)):
        column, row = np.int64(x[i]), np.int64(y[i])
        at = (np.int64(p[i]) * height + row) * width + column
        flat[at] = t[i]
        if column < BORDER or column >= width - BORDER or row < BORDER or row >= height - BORDER:
            continue
        for j in range(len(inner)):
            ring[j] = flat[at + inner[j]]
        if not _has_arc(ring, len(inner), lengths[0], lengths[1]):
            continue
        for j in range(len(outer)):
            ring[j] = flat[at + outer[j]]
        corner[i] = _has_arc(ring, len(outer), lengths[2], lengths[3])
