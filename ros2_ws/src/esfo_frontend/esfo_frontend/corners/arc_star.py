"""Arc* corners on the surface of active events (Alzugaray, Chli, IEEE RA-L 2018)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.events import EventArray
from esfo_frontend.corners.active_surface import BORDER, INNER_CIRCLE, OUTER_CIRCLE, ActiveSurface
from esfo_frontend.errors import FrontendError
from esfo_frontend.options import CornerOptions, nanoseconds

_NEVER = np.iinfo(np.int64).min


class ArcStarDetector:
    """Marks Arc* corners: on both circles the arc grown from the newest pixel, or the rest, has an allowed length.

    Other than with eFAST, the arc may hold single older pixels, and corners wider than 180 degrees count too. An event
    is left out, as one of the many that one edge causes, when its pixel had one of the same polarity less than `kappa`
    ago and none of the other since: it is no corner and does not change the surface (the filter of the paper).
    """

    def __init__(self, width: int, height: int, options: CornerOptions) -> None:
        self._surface = ActiveSurface(width, height)
        self._latest = np.full((height, width, 2), _NEVER, np.int64)
        self._lengths = np.array(
            [options.shortest_inner, options.longest_inner, options.shortest_outer, options.longest_outer]
        )
        self._kappa = nanoseconds(options.kappa)

    def detect(self, events: EventArray) -> NDArray[np.bool_]:
        """Return a mask (N,) of the corner events among `events` (N,), which follow those of earlier calls.

        Raises FrontendError when time goes back; the detector is of no use afterwards.
        """
        self._surface.make_room(len(events))
        corner = np.zeros(len(events), np.bool_)
        times = (self._surface.clock, self._latest, self._kappa)
        back = _detect(events, self._surface.ranks, times, self._lengths, corner)
        if back >= 0:
            raise FrontendError(f"time goes back at {events['t'][back]} ns: events are not sorted")
        return corner


@njit(cache=True, nogil=True)
def _newest_arc(ring, shortest):  # type: ignore[no-untyped-def]
    """Return the length of the arc that grows from the newest pixel of `ring` (n,), algorithm 1 of the paper.

    Two pixels walk away from it, always the newer one (on ties the one against the order of the ring). The arc is
    extended up to the pixel that walks when that is as new as the oldest of the arc, or the arc still too short. Of
    equally new pixels the first one of the ring is the newest.
    """
    size = len(ring)
    newest = 0
    for i in range(1, size):
        if ring[i] > ring[newest]:
            newest = i
    oldest = ahead_oldest = back_oldest = ring[newest]
    ahead, back = 1, 1
    ahead_end = back_end = 0
    while ahead + back < size:
        ahead_value = ring[newest + ahead - (size if newest + ahead >= size else 0)]
        back_value = ring[newest - back]
        grows = ahead_end + back_end + 1 < shortest
        if ahead_value > back_value:
            ahead_oldest = min(ahead_oldest, ahead_value)
            if grows or ahead_value >= oldest:
                ahead_end, oldest = ahead, min(oldest, ahead_oldest)
            ahead += 1
        else:
            back_oldest = min(back_oldest, back_value)
            if grows or back_value >= oldest:
                back_end, oldest = back, min(oldest, back_oldest)
            back += 1
    return ahead_end + back_end + 1


@njit(cache=True, nogil=True)
def _is_corner(surface, at, circle, ring, shortest, longest):  # type: ignore[no-untyped-def]
    """Return whether the arc on the circle (n,) of index offsets, or the rest of it, has an allowed length."""
    for i in range(len(circle)):
        ring[i] = surface[at + circle[i]]
    length = _newest_arc(ring, shortest)
    return shortest <= length <= longest or shortest <= len(ring) - length <= longest


@njit(cache=True, nogil=True)
def _detect(events, ranks, times, lengths, corner):  # type: ignore[no-untyped-def]
    """Write the events into `ranks` (2, height, width) one after the other and mark corners in `corner` (N,).

    times: clock of the surface, latest time (height, width, 2) of every pixel and polarity, kappa; all ns. Returns the
    index of an event earlier than the one before it, where the work has stopped, or -1.
    """
    height, width = ranks.shape[1:]
    surface = ranks.reshape(-1)
    inner, outer = INNER_CIRCLE[1] * width + INNER_CIRCLE[0], OUTER_CIRCLE[1] * width + OUTER_CIRCLE[0]
    inner_ring, outer_ring = np.empty(16, np.int32), np.empty(20, np.int32)
    clock, latest, kappa = times
    rank, last = clock
    for i in range(len(events)):
        event = events[i]
        x, y, p = np.int64(event.x), np.int64(event.y), np.int64(event.p)
        if event.t != last:
            if event.t < last:
                return i
            rank += 1
            last = event.t
        before, opposite = latest[y, x, p], latest[y, x, 1 - p]
        latest[y, x, p] = event.t
        if kappa > 0 and event.t <= before + kappa and opposite <= before:
            continue
        at = (p * height + y) * width + x
        surface[at] = rank
        if x < BORDER or x >= width - BORDER or y < BORDER or y >= height - BORDER:
            continue
        corner[i] = _is_corner(surface, at, inner, inner_ring, lengths[0], lengths[1]) and _is_corner(
            surface, at, outer, outer_ring, lengths[2], lengths[3]
        )
    clock[0], clock[1] = rank, last
    return -1
