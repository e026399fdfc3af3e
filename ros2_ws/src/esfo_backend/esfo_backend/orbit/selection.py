"""Which points to keep where not all of them can be: the longest of every part of the time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from esfo_backend.orbit.parametrization import Observations
from esfo_core.tracks import Tracks

_PARTS = 16


def spread(begin: NDArray[np.int64], rows: NDArray[np.int64], rank: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Choose at most `count` of M tracks; returns their indices, ascending.

    begin: (M,) time of the first row. rows: (M,) number of rows. rank: (M,) tracks of a lower rank go first. Within a
    rank time is cut into 16 parts, each of which gives its longest track in turn, so that all azimuths and revolutions
    keep a share; ties go to the earlier track.
    """
    if len(begin) <= count:
        return np.arange(len(begin))
    span = max(int(begin.max() - begin.min()), 1)
    part = np.minimum((begin - begin.min()) * _PARTS // span, _PARTS - 1)
    order = np.lexsort((begin, -rows, part, rank))
    new = np.diff(rank[order] * _PARTS + part[order], prepend=-1) != 0
    place = np.arange(len(order))
    turn = place - np.maximum.accumulate(np.where(new, place, 0))  # place of a track among those of its rank and part
    return np.sort(order[np.lexsort((-rows[order], turn, rank[order]))[:count]])


def spread_tracks(tracks: Tracks, count: int) -> Tracks:
    """Return the rows of at most `count` tracks, chosen by `spread`; `tracks` itself when it has no more."""
    ids, index, rows = np.unique(tracks.track_id, return_inverse=True, return_counts=True)
    if len(ids) <= count:
        return tracks
    begin = np.full(len(ids), np.iinfo(np.int64).max)
    np.minimum.at(begin, index, tracks.t)
    kept = np.zeros(len(ids), bool)
    kept[spread(begin, rows, np.zeros(len(ids), np.int64), count)] = True
    return tracks.select(kept[index])


def longest_points(obs: Observations, count: int) -> Observations:
    """Return at most `count` points, chosen by `spread`; `obs` itself when it has no more."""
    if obs.points <= count:
        return obs
    first = obs.rows.first
    begin = np.round(obs.rows.dt[first[:-1]] * 1e9).astype(np.int64)
    chosen = spread(begin, np.diff(first), np.zeros(obs.points, np.int64), count)
    label = np.full(obs.points, -1, np.int64)
    label[chosen] = np.arange(len(chosen))
    return obs.regroup(label)
