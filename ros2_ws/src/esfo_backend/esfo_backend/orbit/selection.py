"""Selection of a limited number of tracks: the longest of each time interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from esfo_backend.orbit.observations import Observations
from esfo_core.tracks import Tracks

_PARTS = 16


@dataclass(frozen=True)
class TrackTable:
    """One entry per track. ids: (M,), ascending. begin: (M,) time of the first row, ns. rows: (M,) number of rows.

    index: (N,) entry of each row.
    """

    ids: NDArray[np.uint32]
    begin: NDArray[np.int64]
    rows: NDArray[np.int64]
    index: NDArray[np.int64]

    @staticmethod
    def of(tracks: Tracks) -> TrackTable:
        """Return the table of some tracks."""
        ids, index, rows = np.unique(tracks.track_id, return_inverse=True, return_counts=True)
        begin = np.full(len(ids), np.iinfo(np.int64).max)
        np.minimum.at(begin, index, tracks.t)
        return TrackTable(ids, begin, rows, index)

    def rows_of(self, tracks: Tracks, chosen: NDArray[np.int64]) -> Tracks:
        """Return the rows of the chosen entries, in their order. tracks: those that the table was made from."""
        kept = np.zeros(len(self.ids), bool)
        kept[chosen] = True
        return tracks.select(kept[self.index])


def spread(begin: NDArray[np.int64], rows: NDArray[np.int64], rank: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Choose at most `count` of M tracks; returns their indices, ascending.

    begin: (M,) time of the first row. rows: (M,) number of rows. rank: (M,) lower ranks are chosen first. In a rank,
    time is divided into 16 intervals, of which each gives its longest remaining track in each round, so that all
    azimuths and revolutions are represented; of equally long tracks the earlier one is chosen.
    """
    if len(begin) <= count:
        return np.arange(len(begin))
    span = max(int(begin.max() - begin.min()), 1)
    part = np.minimum((begin - begin.min()) * _PARTS // span, _PARTS - 1)
    order = np.lexsort((begin, -rows, part, rank))
    new = np.diff(rank[order] * _PARTS + part[order], prepend=-1) != 0
    place = np.arange(len(order))
    round_ = place - np.maximum.accumulate(np.where(new, place, 0))  # index within the rank and the interval
    return np.sort(order[np.lexsort((-rows[order], round_, rank[order]))[:count]])


def spread_tracks(tracks: Tracks, count: int) -> Tracks:
    """Return the rows of at most `count` tracks, chosen by `spread`; `tracks` itself when it has no more."""
    table = TrackTable.of(tracks)
    if len(table.ids) <= count:
        return tracks
    return table.rows_of(tracks, spread(table.begin, table.rows, np.zeros(len(table.ids), np.int64), count))


def longest_points(obs: Observations, count: int) -> Observations:
    """Return at most `count` landmarks, chosen by `spread`; `obs` itself when it has no more."""
    if obs.points <= count:
        return obs
    first = obs.rows.first
    begin = np.round(obs.rows.dt[first[:-1]] * 1e9).astype(np.int64)
    chosen = spread(begin, np.diff(first), np.zeros(obs.points, np.int64), count)
    label = np.full(obs.points, -1, np.int64)
    label[chosen] = np.arange(len(chosen))
    return obs.regroup(label)
