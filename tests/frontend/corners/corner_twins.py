"""Plain twins of the corner detectors: surface of times in ns, every arc tried, one step at a time."""

import numpy as np
from numba import njit

from esfo_frontend.corners.active_surface import BORDER, INNER_CIRCLE, OUTER_CIRCLE

NEVER = np.iinfo(np.int64).min
USUAL = (3, 6, 4, 8)


@njit(cache=True)
def has_arc_twin(ring, shortest, longest):
    """Every start and length: all of the arc newer than all of the rest."""
    n = len(ring)
    for start in range(n):
        for length in range(shortest, longest + 1):
            oldest, rest = ring[start], ring[start - 1]
            for i in range(n):
                value = ring[(start + i) % n]
                if i < length:
                    oldest = min(oldest, value)
                else:
                    rest = max(rest, value)
            if oldest > rest:
                return True
    return False


@njit(cache=True)
def efast_twin(x, y, p, t, size, lengths):
    """Mask (N,) of the eFAST corners among events in columns (N,); size: width and height."""
    width, height = size
    surface = np.full((2, height, width), NEVER, np.int64)
    corner = np.zeros(len(t), np.bool_)
    inner, outer = np.empty(16, np.int64), np.empty(20, np.int64)
    for i in range(len(t)):
        surface[p[i], y[i], x[i]] = t[i]
        if x[i] < BORDER or x[i] >= width - BORDER or y[i] < BORDER or y[i] >= height - BORDER:
            continue
        for j in range(16):
            inner[j] = surface[p[i], y[i] + INNER_CIRCLE[1, j], x[i] + INNER_CIRCLE[0, j]]
        for j in range(20):
            outer[j] = surface[p[i], y[i] + OUTER_CIRCLE[1, j], x[i] + OUTER_CIRCLE[0, j]]
        corner[i] = has_arc_twin(inner, lengths[0], lengths[1]) and has_arc_twin(outer, lengths[2], lengths[3])
    return corner


def newest_arc_twin(ring, shortest):
    """Length of the arc of algorithm 1 of Alzugaray and Chli, with the arc as a list of ring indices."""
    n = len(ring)
    newest = int(np.argmax(ring))
    arc = [newest]
    clockwise, counter = (newest + 1) % n, (newest - 1) % n
    while clockwise != counter:
        if ring[clockwise] > ring[counter]:
            if len(arc) < shortest or ring[clockwise] >= min(ring[i] for i in arc):
                while arc[-1] != clockwise:
                    arc.append((arc[-1] + 1) % n)
            clockwise = (clockwise + 1) % n
        else:
            if len(arc) < shortest or ring[counter] >= min(ring[i] for i in arc):
                while arc[0] != counter:
                    arc.insert(0, (arc[0] - 1) % n)
            counter = (counter - 1) % n
    return len(arc)


def arc_star_twin(events, size, lengths, kappa):
    """Mask (N,) of the Arc* corners; kappa in ns, 0 for no filter."""
    width, height = size
    surface = np.full((2, height, width), NEVER, np.int64)
    latest = {}

    def allowed(ring, shortest, longest):
        length = newest_arc_twin(ring, shortest)
        return shortest <= length <= longest or shortest <= len(ring) - length <= longest

    corner = []
    for x, y, p, t in events.tolist():
        same, other = latest.get((x, y, p), NEVER), latest.get((x, y, 1 - p), NEVER)
        latest[x, y, p] = t
        if kappa and not (t > same + kappa or other > same):
            corner.append(False)
            continue
        surface[p, y, x] = t
        corner.append(
            BORDER <= x < width - BORDER
            and BORDER <= y < height - BORDER
            and allowed(surface[p, y + INNER_CIRCLE[1], x + INNER_CIRCLE[0]], *lengths[:2])
            and allowed(surface[p, y + OUTER_CIRCLE[1], x + OUTER_CIRCLE[0]], *lengths[2:])
        )
    return np.array(corner, bool)
