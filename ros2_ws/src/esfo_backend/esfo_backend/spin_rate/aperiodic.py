"""Cause of an aperiodic event stream, from track motion: no motion, no rotation, or less than one revolution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from esfo_core.events import NS_PER_S
from esfo_core.orbit import Matrix
from esfo_core.tracks import Tracks

_MIN_ROWS = 4
_MIN_MOTION_PX = 3.0
_SHARE, _SAME_VELOCITY = 0.9, 0.15
"""A translation: nine tenths of the tracks have the same velocity within 15 %. Velocities of a translating body differ
by its depth over its distance; those of a spinning body range from nearly zero, at its outline, to the largest."""
_ONE_REVOLUTION = 1.0
_MIN_CHANGE, _MAX_CHANGE = -0.9, 3.0
"""Range of the relative change of distance over the recording in which a translation is searched."""
_DISTANCES = 40


@dataclass(frozen=True)
class AperiodicCause:
    """Reason and flag of the verdict."""

    reason: str
    flag: str


def explain_aperiodic(tracks: Tracks, duration_s: float, min_points: int, focal_px: float) -> AperiodicCause:
    """Return the cause from the motion of the tracks. duration_s: length of the recording.

    In a revolution a point of a spinning object moves by at most 2 pi times the image radius of the object, times the
    magnification of its near side. So the median speed gives a lower bound on the revolutions of a rotation.
    """
    ends = _ends(tracks)
    moving = np.linalg.norm(ends.uv[1] - ends.uv[0], axis=1) > _MIN_MOTION_PX
    if moving.sum() < min_points:
        return AperiodicCause(
            f"{int(moving.sum())} tracks move; {min_points} are needed to detect a rotation", "too_few_tracks"
        )
    ends = Ends(ends.uv[:, moving], ends.s[:, moving])
    spread = translation_spread(ends)
    if spread < _SAME_VELOCITY:
        return AperiodicCause(
            f"{_SHARE:.0%} of the tracks move as in a translation, within {spread:.0%} of the median speed",
            "not_a_rotation",
        )
    place = tracks.uv - np.median(tracks.uv, axis=0)
    radius = max(float(np.quantile(np.linalg.norm(place, axis=1), 0.9)), 1.0)
    # A ball in the distance d, seen at this radius, has the radius r d and spins at w: its nearest point is (1 - r) d
    # away and moves by w r / (1 - r), its outline is at r / sqrt(1 - r^2), both in the plane z = 1.
    r = radius / np.hypot(radius, focal_px)
    revolutions = ends.speed * duration_s / (2 * np.pi * radius) * np.sqrt((1 - r) / (1 + r))
    if revolutions >= _ONE_REVOLUTION:
        return AperiodicCause(
            f"a rotation of this image speed would have repeated: it makes {revolutions:.1f} revolutions or more",
            "no_repetition",
        )
    return AperiodicCause("less than one revolution may have been observed", "too_few_turns")


@dataclass(frozen=True)
class Ends:
    """First and last rows of M tracks: uv (2, M, 2) px, and s (2, M), seconds since the first of all."""

    uv: Matrix
    s: Matrix

    @property
    def velocity(self) -> Matrix:
        """Mean velocity (M, 2), px/s."""
        return np.asarray((self.uv[1] - self.uv[0]) / (self.s[1] - self.s[0])[:, None])

    @property
    def speed(self) -> float:
        """Median speed, px/s."""
        return float(np.median(np.linalg.norm(self.velocity, axis=1)))


def translation_spread(ends: Ends) -> float:
    """Largest distance of nine tenths of the velocities from a translation's, relative to the median speed.

    The velocity is constant in space. Seen from the camera, a point at X + T t is at x(t) with x (1 + c t) = x0 + a t,
    a and c common to points of one depth; c is the change of the depth per second, relative. So between the rows of a
    track dx + c d(x t) = a dt, and for a given c, a is a median.
    """
    length = float(ends.s.max())
    middle, dt = ends.s.mean(axis=0), ends.s[1] - ends.s[0]
    growth = (ends.uv[1] * ends.s[1, :, None] - ends.uv[0] * ends.s[0, :, None]) / dt[:, None]

    def off(c: float) -> float:
        a = ends.velocity + c * growth
        return float(np.quantile(np.linalg.norm(a - np.median(a, axis=0), axis=1) / (1 + c * middle), _SHARE))

    changes = np.linspace(_MIN_CHANGE, _MAX_CHANGE, _DISTANCES) / length
    best = changes[np.argmin([off(c) for c in changes])]
    step = changes[1] - changes[0]
    found = minimize_scalar(off, bounds=(max(best - step, changes[0]), best + step), method="bounded")
    return float(min(found.fun, off(best))) / ends.speed


def _ends(tracks: Tracks) -> Ends:
    """Return the ends of the tracks of at least 4 rows."""
    ordered = tracks.sorted()
    _, first, count = np.unique(ordered.track_id, return_index=True, return_counts=True)
    enough = count >= _MIN_ROWS
    rows = np.stack([first[enough], (first + count - 1)[enough]])
    s = (ordered.t - ordered.t.min(initial=np.iinfo(np.int64).max)) / NS_PER_S
    seconds: Matrix = s[rows]
    seconds[1] = np.maximum(seconds[1], seconds[0] + 1e-9)
    return Ends(ordered.uv[rows].astype(np.float64), seconds)
