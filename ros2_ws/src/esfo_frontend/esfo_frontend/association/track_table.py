"""The table of tracks being followed, in slots, and the grid in which they are found."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

TRACK_DTYPE = np.dtype(
    [
        ("alive", np.bool_),
        ("polarity", np.int64),
        # Number in the order of birth, and the id once there is a row, -1 before.
        ("born", np.int64),
        ("id", np.int64),
        # Cell of the grid, and the neighbours in the list of the cell, -1 for none.
        ("cell", np.int64),
        ("next", np.int64),
        ("previous", np.int64),
        # Corners so far; time of the last one and the time when the track ends without another, ns.
        ("corners", np.int64),
        ("t", np.int64),
        ("deadline", np.int64),
        # Place, px, and velocity, px/s, at t.
        ("x", np.float64),
        ("y", np.float64),
        ("vx", np.float64),
        ("vy", np.float64),
        # Pixel of the first corner, from which the sums count; weighted sums of 1, t, t^2, x, y, t x, t y, where t is
        # in s from the last corner.
        ("x0", np.float64),
        ("y0", np.float64),
        ("s1", np.float64),
        ("st", np.float64),
        ("stt", np.float64),
        ("sx", np.float64),
        ("sy", np.float64),
        ("stx", np.float64),
        ("sty", np.float64),
        # The row being averaged: corners, time of the first, ns, place of the track then; sums from that time and from
        # (x0, y0).
        ("row_n", np.int64),
        ("row_t0", np.int64),
        ("row_x", np.float64),
        ("row_y", np.float64),
        ("row_st", np.float64),
        ("row_stt", np.float64),
        ("row_sx", np.float64),
        ("row_sy", np.float64),
        ("row_stx", np.float64),
        ("row_sty", np.float64),
        ("row_sq", np.float64),
    ],
    align=True,
)

ROW_DTYPE = np.dtype(
    [
        ("id", np.int64),
        ("t", np.int64),
        ("u", np.float64),
        ("v", np.float64),
        # Corners, and the sum of their squared distances, px^2, to the line fitted to them over time.
        ("n", np.int64),
        ("residual", np.float64),
    ],
    align=True,
)

SHARED_DTYPE = np.dtype([("born", np.int64), ("next_id", np.int64), ("free", np.int64), ("speed", np.float64)])
"""Tracks born so far, next id, number of free slots, and the typical speed of tracks with an id, px/s; 0: unknown."""

NO_TRACK = -1


class Grid(NamedTuple):
    """Tracks by the cell of their place. first: (rows, columns) slot at the head of each cell's list. edge: px."""

    first: NDArray[np.int64]
    edge: float


@njit(cache=True, nogil=True)
def link(tracks, k, grid):  # type: ignore[no-untyped-def]
    """Put the track at the head of the list of its cell."""
    track = tracks[k]
    height, width = grid.first.shape
    row = min(max(int(track.y / grid.edge), 0), height - 1)
    column = min(max(int(track.x / grid.edge), 0), width - 1)
    track.cell = row * width + column
    track.previous, track.next = -1, grid.first[row, column]
    if track.next >= 0:
        tracks[track.next].previous = k
    grid.first[row, column] = k


@njit(cache=True, nogil=True)
def unlink(tracks, k, grid):  # type: ignore[no-untyped-def]
    """Take the track out of the list of its cell."""
    track = tracks[k]
    if track.next >= 0:
        tracks[track.next].previous = track.previous
    if track.previous >= 0:
        tracks[track.previous].next = track.next
    else:
        width = grid.first.shape[1]
        grid.first[track.cell // width, track.cell % width] = track.next


@njit(cache=True, nogil=True)
def expire(state, until, ended):  # type: ignore[no-untyped-def]
    """Free the slots of the tracks whose deadline lies before `until` ns; return how many of them had an id.

    ended: gets these ids, room for all.
    """
    tracks, grid, every, free = state
    shared, count = every[0], 0
    for k in range(len(tracks)):
        track = tracks[k]
        if track.alive and track.deadline < until:
            unlink(tracks, k, grid)
            track.alive = False
            free[shared.free] = k
            shared.free += 1
            if track.id >= 0:
                ended[count] = track.id
                count += 1
    return count
