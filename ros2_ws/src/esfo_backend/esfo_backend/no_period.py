"""Why an event stream has no period: nothing moves, what moves does not turn, or too little of a turn was seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esfo_core.orbit import NANOSECONDS, Matrix, Vector
from esfo_core.tracks import Tracks

_LEAST_ROWS = 4
_MOVES_PX = 3.0
_SAME_VELOCITY = 0.1
"""Points of a spinning object move at every speed from nothing, at its rim, to the largest."""
_ONE_TURN = 1.0


@dataclass(frozen=True)
class NoPeriod:
    """A sentence and the flag of the verdict."""

    reason: str
    flag: str


def why_no_period(tracks: Tracks, duration_s: float, min_points: int) -> NoPeriod:
    """Look at how tracks move. duration_s: length of the recording.

    A point of a spinning object moves by at most 2 pi times the image radius of the object in a turn; so the typical
    speed gives a number of turns that must have been seen, were it a rotation.
    """
    path, velocity = _motions(tracks)
    moving = path > _MOVES_PX
    if moving.sum() < min_points:
        return NoPeriod(f"{int(moving.sum())} tracks move, {min_points} are needed to see a rotation", "not_a_rotation")
    typical = np.median(velocity[moving], axis=0)
    spread = float(np.median(np.linalg.norm(velocity[moving] - typical, axis=1)) / np.linalg.norm(typical))
    if spread < _SAME_VELOCITY:
        return NoPeriod(f"all tracks move alike (velocities within {spread:.0%}): a translation", "not_a_rotation")
    place = tracks.uv - np.median(tracks.uv, axis=0)
    radius = float(np.quantile(np.linalg.norm(place, axis=1), 0.9))
    turns = float(np.median(np.linalg.norm(velocity[moving], axis=1))) * duration_s / (2 * np.pi * max(radius, 1.0))
    if turns >= _ONE_TURN:
        return NoPeriod(
            f"a rotation that moves like this would have turned {turns:.1f} times or more", "not_a_rotation"
        )
    return NoPeriod("less than a turn may have been seen", "too_few_turns")


def _motions(tracks: Tracks) -> tuple[Vector, Matrix]:
    """Way from first to last row, px, (M,), and mean velocity, px/s, (M, 2), of every track that has some rows."""
    ordered = tracks.sorted()
    _, first, count = np.unique(ordered.track_id, return_index=True, return_counts=True)
    enough = count >= _LEAST_ROWS
    begin, end = first[enough], (first + count - 1)[enough]
    way = (ordered.uv[end] - ordered.uv[begin]).astype(np.float64)
    seconds = (ordered.t[end] - ordered.t[begin]) / NANOSECONDS
    return np.linalg.norm(way, axis=1), way / np.maximum(seconds, 1e-9)[:, None]
