"""Variance that comes from errors which several landmarks share at the same time: a trembling camera, a lamp.

The variance of an estimate is a sum over pairs of rows of the product of their influences. Clusters by landmark count
the pairs of one landmark; clusters by time add the pairs of different landmarks that are near in time (two-way
clustering: Cameron, Gelbach and Miller, J. Business and Economic Statistics 2011; with a kernel over time, Thompson,
J. Financial Economics 2011). How long errors last is not known, so that several widths are tried.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.orbit import Matrix, Vector

_BINS_PER_WIDTH = 4
_LONGEST_TURNS = 0.25
_LEAST_WIDTHS = 12
"""Widths that the recording must hold: the scatter of a variance that is measured by fewer says nothing."""
_MOST_LEVELS = 10
_LEAST_SEEN = 2.0
"""Widths, at least, that a landmark counts as seen in; one that is seen in fewer has no influence to speak of."""


class Timeline(NamedTuple):
    """When landmarks were seen. dt: (N,) s, ascending for each landmark. first: (P + 1,) as in `ObservationRows`."""

    dt: Vector
    first: NDArray[np.int64]
    rate_hz: float


def common_variance(influence: Matrix, seen: Timeline, coordinates: int = 3) -> Vector:
    """Variance (S,) that the pairs of rows of different landmarks add to that of each parameter, at least 0.

    influence: (N, S) change of each parameter by each row. coordinates: that were estimated of each landmark. Pairs are
    weighted by a triangle over their distance in time (Bartlett's kernel). Its width starts at a quarter of a turn and
    halves down to the time between two rows of a landmark; the width of the largest variance counts, for each parameter
    by itself.
    """
    parameters = influence.shape[1]
    largest = np.zeros(parameters)
    for width in _widths(seen):
        step = width / _BINS_PER_WIDTH
        bins = np.floor((seen.dt - seen.dt.min()) / step).astype(np.int64)
        count = int(bins.max()) + 1
        small_sample = count / (count - parameters * _BINS_PER_WIDTH)
        shown = influence * _unabsorbed(seen, width, coordinates)[:, None]
        every, own = _over_time(shown, bins, count), _within_landmarks(shown, bins, seen.first, _BINS_PER_WIDTH)
        largest = np.maximum(largest, small_sample * every - own)
    return largest


def _unabsorbed(seen: Timeline, width: float, coordinates: int) -> Vector:
    """Factor (N,) by which errors that last a width are larger than the residuals, because landmarks take up a part.

    A landmark has some coordinates, for two such errors in each width in which it is seen.
    """
    time = np.minimum(np.diff(seen.dt, append=np.inf), width)
    time[seen.first[1:] - 1] = width
    errors = 2 * np.maximum(np.add.reduceat(time, seen.first[:-1]) / width, _LEAST_SEEN)
    return np.repeat(np.sqrt(errors / (errors - coordinates)), np.diff(seen.first))


def _widths(seen: Timeline) -> list[float]:
    """Widths in s, the longest first; none where the recording is too short for any."""
    inside = np.ones(len(seen.dt), bool)
    inside[seen.first[:-1]] = False
    gaps = np.diff(seen.dt, prepend=0.0)[inside]
    gaps = gaps[gaps > 0]
    if not len(gaps):
        return []
    longest = min(_LONGEST_TURNS / seen.rate_hz, float(np.ptp(seen.dt)) / _LEAST_WIDTHS)
    halved = longest * 0.5 ** np.arange(_MOST_LEVELS)
    return [float(width) for width in halved if width >= np.median(gaps)]


def _over_time(influence: Matrix, bins: NDArray[np.int64], count: int) -> Vector:
    """Sum (S,) over all pairs of rows, weighted by the triangle: the mean square over all places of a sliding sum."""
    total = np.zeros((count + 2 * _BINS_PER_WIDTH, influence.shape[1]))
    np.add.at(total, bins + _BINS_PER_WIDTH, influence)
    summed = np.cumsum(total, axis=0)
    sliding = summed[_BINS_PER_WIDTH:] - summed[:-_BINS_PER_WIDTH]
    return np.asarray((sliding**2).sum(axis=0) / _BINS_PER_WIDTH)


@njit(cache=True, nogil=True)
def _within_landmarks(influence: Matrix, bins: NDArray[np.int64], first: NDArray[np.int64], width: int) -> Vector:
    """The same sum over the pairs of one landmark, whose rows are in the order of time."""
    out = np.zeros(influence.shape[1])
    for j in range(len(first) - 1):
        for k in range(first[j], first[j + 1]):
            for m in range(k, first[j] - 1, -1):
                apart = bins[k] - bins[m]
                if apart >= width:
                    break
                weight = (1.0 if m == k else 2.0) * (width - apart) / width
                for s in range(len(out)):
                    out[s] += weight * influence[k, s] * influence[m, s]
    return out
