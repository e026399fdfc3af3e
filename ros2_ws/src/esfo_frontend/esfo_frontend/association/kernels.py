"""Kernels of the association: nearest track, weighted line through its corners, rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from esfo_core.events import NS_PER_S
from esfo_frontend.association.track_table import NO_TRACK, link, unlink

S_PER_NS = 1 / NS_PER_S

SPEED_STEP = 1.002
"""Factor by which a corner moves the typical speed towards that of its track: a running median over ~1000 corners."""

SLOWEST = 0.1
"""Least speed at which a track forgets its corners, as a share of the typical speed."""


class Limits(NamedTuple):
    """`AssociationOptions` as the kernels read them: squared distances, px^2; longest_gap in ns."""

    gate2: float
    spacing2: float
    memory: float
    coast: float
    wait: float
    longest_gap: float
    step2: float
    lag: float
    first_corners: int
    min_corners: int


@njit(cache=True, nogil=True)
def associate(corners, state, limits, label, rows):  # type: ignore[no-untyped-def]
    """Give each corner to a track, or let it begin one; return how many rows were completed.

    corners: columns x, y, p, t (N,), t in ns. state: (tracks, grid, shared, free slots). label: (N,) gets the id of
    the track of each corner, -1 where it has none yet. rows: `ROW_DTYPE`, room for N.
    """
    x, y, p, t = corners
    tracks, grid, every, free = state
    shared, count = every[0], 0
    for i in range(len(t)):
        k, crowded = nearest_track((x[i], y[i], p[i], t[i]), tracks, grid, limits)
        label[i] = NO_TRACK
        if k < 0 and crowded:
            continue
        if k < 0:
            shared.free -= 1
            k = free[shared.free]
            begin_track(tracks[k], (x[i], y[i], p[i], t[i]), shared)
        else:
            unlink(tracks, k, grid)
        track = tracks[k]
        update_track(track, x[i], y[i], t[i], shared, limits)
        link(tracks, k, grid)
        if add_to_row(track, x[i], y[i], t[i], limits):
            if track.id < 0 and track.corners >= limits.first_corners:
                track.id = shared.next_id
                shared.next_id += 1
            if track.id >= 0:
                write_row(track, limits.lag, rows[count])
                count += 1
            track.row_n = 0
        label[i] = track.id
    return count


@njit(cache=True, nogil=True)
def nearest_track(corner, tracks, grid, limits):  # type: ignore[no-untyped-def]
    """Return the slot of the track that is predicted nearest within the gate, -1 for none, and whether it is crowded.

    Of two equally near tracks the older one is taken. Crowded: a track with an id is predicted nearer than the spacing.
    """
    x, y, p, t = corner
    column, row = int(x / grid.edge), int(y / grid.edge)
    best, least, crowded = -1, limits.gate2, False
    for r in range(max(row - 1, 0), min(row + 2, grid.first.shape[0])):
        for c in range(max(column - 1, 0), min(column + 2, grid.first.shape[1])):
            k = grid.first[r, c]
            while k >= 0:
                track = tracks[k]
                if track.polarity == p and t <= track.deadline:
                    dt = (t - track.t) * S_PER_NS
                    dx, dy = x - track.x - track.vx * dt, y - track.y - track.vy * dt
                    d2 = dx * dx + dy * dy
                    if d2 < least or (d2 == least and (best < 0 or track.born < tracks[best].born)):
                        best, least = k, d2
                    crowded = crowded or (track.id >= 0 and d2 < limits.spacing2)
                k = track.next
    return best, crowded


@njit(cache=True, nogil=True)
def begin_track(track, corner, shared):  # type: ignore[no-untyped-def]
    """Make a track without corners at the place of its first one."""
    x, y, p, t = corner
    track.alive, track.polarity, track.born, track.id = True, p, shared.born, NO_TRACK
    shared.born += 1
    track.corners, track.t, track.row_n = 0, t, 0
    track.x, track.y, track.vx, track.vy = x, y, 0.0, 0.0
    track.x0, track.y0 = x, y
    track.s1 = track.st = track.stt = 0.0
    track.sx = track.sy = track.stx = track.sty = 0.0


@njit(cache=True, nogil=True)
def update_track(track, x, y, t, shared, limits):  # type: ignore[no-untyped-def]
    """Fit the line through the track's corners anew: least squares, weights that decay with the image motion.

    The velocity is shrunk by E / (E + 2), E = squared path explained by it: the corners scatter by about 1 px in both
    coordinates, so a velocity that explains less than that is chance.
    """
    dt = (t - track.t) * S_PER_NS
    speed = np.hypot(track.vx, track.vy)
    keep = np.exp(-max(speed, SLOWEST * shared.speed) * dt / limits.memory)
    x, y = x - track.x0, y - track.y0
    # The origin of time moves on by dt.
    track.stt = keep * (track.stt - 2 * dt * track.st + dt * dt * track.s1)
    track.st = keep * (track.st - dt * track.s1)
    track.stx = keep * (track.stx - dt * track.sx)
    track.sty = keep * (track.sty - dt * track.sy)
    track.s1 = keep * track.s1 + 1.0
    track.sx = keep * track.sx + x
    track.sy = keep * track.sy + y
    track.t, track.corners = t, track.corners + 1
    mean = track.st / track.s1
    spread = track.stt - track.s1 * mean * mean
    if spread > 0.0 and track.corners > 3:
        vx, vy = (track.stx - mean * track.sx) / spread, (track.sty - mean * track.sy) / spread
        explained = (vx * vx + vy * vy) * spread
        shrink = explained / (explained + 2.0)
        track.vx, track.vy = vx * shrink, vy * shrink
    track.x = track.x0 + track.sx / track.s1 - track.vx * mean
    track.y = track.y0 + track.sy / track.s1 - track.vy * mean
    set_deadline(track, shared, limits)


@njit(cache=True, nogil=True)
def set_deadline(track, shared, limits):  # type: ignore[no-untyped-def]
    """Note when the track ends without another corner, and let its speed count in the typical one."""
    speed = np.hypot(track.vx, track.vy)
    coast = limits.coast
    if track.id >= 0 and speed > 0.0:
        if shared.speed == 0.0:
            shared.speed = speed
        shared.speed *= SPEED_STEP if speed > shared.speed else 1.0 / SPEED_STEP
    elif track.id < 0:
        coast *= 0.5
    gap = limits.longest_gap
    if speed * gap > coast * NS_PER_S:
        gap = coast * NS_PER_S / speed
    if shared.speed * gap > limits.wait * NS_PER_S:
        gap = limits.wait * NS_PER_S / shared.speed
    track.deadline = track.t + np.int64(gap)


@njit(cache=True, nogil=True)
def add_to_row(track, x, y, t, limits):  # type: ignore[no-untyped-def]
    """Add the corner to the row being averaged; return whether the row is complete."""
    if track.row_n == 0:
        track.row_t0, track.row_x, track.row_y = t, track.x, track.y
        track.row_st = track.row_stt = track.row_sx = track.row_sy = 0.0
        track.row_stx = track.row_sty = track.row_sq = 0.0
    s, x, y = (t - track.row_t0) * S_PER_NS, x - track.x0, y - track.y0
    track.row_n += 1
    track.row_st += s
    track.row_stt += s * s
    track.row_sx += x
    track.row_sy += y
    track.row_stx += s * x
    track.row_sty += s * y
    track.row_sq += x * x + y * y
    moved = (track.x - track.row_x) ** 2 + (track.y - track.row_y) ** 2
    return track.row_n >= limits.min_corners and moved >= limits.step2


@njit(cache=True, nogil=True)
def write_row(track, lag, row):  # type: ignore[no-untyped-def]
    """Average the corners of the row and move it `lag` px ahead; their scatter is that about a line over time."""
    n = track.row_n
    s, x, y = track.row_st / n, track.row_sx / n, track.row_sy / n
    spread = track.row_stt - n * s * s
    scatter = track.row_sq - n * (x * x + y * y)
    if spread > 0.0:
        scatter -= ((track.row_stx - n * s * x) ** 2 + (track.row_sty - n * s * y) ** 2) / spread
    row.id, row.n, row.residual = track.id, n, max(scatter, 0.0)
    row.t = track.row_t0 + np.int64(np.rint(s * NS_PER_S))
    ahead = lag / max(np.hypot(track.vx, track.vy), 1e-9)
    row.u, row.v = track.x0 + x + ahead * track.vx, track.y0 + y + ahead * track.vy
