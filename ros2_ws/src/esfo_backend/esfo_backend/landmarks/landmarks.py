"""Landmarks from tracks: re-identification, then pruning of tracks that are not of a fixed point."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution, bundle_adjustment
from esfo_backend.errors import BackendError
from esfo_backend.landmarks.reidentification import ROUND_ITERATIONS, Labels, point_rms, reidentify
from esfo_backend.options import BackendOptions
from esfo_backend.orbit.observations import Observations
from esfo_backend.orbit.projection import row_errors
from esfo_core.orbit import Matrix

_PRUNING_ROUNDS = 2


@dataclass(frozen=True)
class Landmarks:
    """Observations by landmark, the solution, and the landmark (M,) of each track, -1 for none."""

    obs: Observations
    solution: OrbitSolution
    label: Labels


def build_landmarks(solution: OrbitSolution, obs: Observations, options: BackendOptions) -> Landmarks:
    """Re-identify with the rate fixed, then free, then adjust with a tighter loss: the best order in benchmarks.

    obs: one landmark per track (M).
    """
    loose, tight = options.initialisation.cauchy_px, options.graph.cauchy_px
    label = np.arange(obs.points)
    if not options.reidentification.enabled:
        return Landmarks(obs, solution, label)
    solution, label = reidentify(solution, obs, label, options.reidentification, loose, False)
    solution = bundle_adjustment(solution.motion, solution.y, obs.regroup(label), loose, iterations=ROUND_ITERATIONS)
    solution, label = reidentify(solution, obs, label, options.reidentification, loose, True)
    grouped = obs.regroup(label)
    solution = bundle_adjustment(solution.motion, solution.y, grouped, tight, iterations=ROUND_ITERATIONS)
    return Landmarks(grouped, solution, label)


def prune(landmarks: Landmarks, options: BackendOptions) -> Landmarks:
    """Drop landmarks that are not fixed points (silhouettes, false tracks) and refit; done twice.

    Raises BackendError when too few landmarks are left.
    """
    limit_px, needed = options.graph.prune_px, options.verdict.min_points
    for _ in range(_PRUNING_ROUNDS):
        motion, y = landmarks.solution.motion, landmarks.solution.y
        errors = row_errors(motion.Q, motion.rate_hz, y, landmarks.obs.rows)
        keep = (point_rms(errors, landmarks.obs) < limit_px) & _near(y)
        if keep.sum() < needed:
            raise BackendError(
                f"only {int(keep.sum())} of {len(keep)} landmarks follow one rotation to {limit_px} px; "
                f"{needed} are needed",
                "too_few_points",
            )
        landmarks = _keep(landmarks, keep)
        solution = bundle_adjustment(motion, landmarks.solution.y, landmarks.obs, options.graph.cauchy_px)
        landmarks = replace(landmarks, solution=solution)
    return landmarks


def drop_far(landmarks: Landmarks) -> Landmarks:
    """Drop landmarks farther from the object's centre than the camera: tracks without parallax, of diverging depth."""
    keep = _near(landmarks.solution.y)
    return landmarks if keep.all() else _keep(landmarks, keep)


def _near(y: Matrix) -> NDArray[np.bool_]:
    """Which of y (P, 3) are nearer to the object's centre than the camera is, (P,)."""
    middle = np.array([0.0, 0.0, np.median(y[:, 2])])
    return np.asarray(np.linalg.norm(y - middle, axis=1) < np.hypot(1.0, middle[2]))


def _keep(landmarks: Landmarks, keep: NDArray[np.bool_]) -> Landmarks:
    new_label = np.where(keep, np.cumsum(keep) - 1, -1)
    label = np.where(landmarks.label >= 0, new_label[landmarks.label], -1)
    solution = replace(landmarks.solution, y=landmarks.solution.y[keep])
    return Landmarks(landmarks.obs.regroup(new_label), solution, label)


def reobservable_points(obs: Observations, rate_hz: float) -> int:
    """Number of landmarks observed one revolution or more before the end, or after the beginning, of the data."""
    dt, first = obs.rows.dt, obs.rows.first
    again = (dt[first[:-1]] <= dt.max() - 1 / rate_hz) | (dt[first[1:] - 1] >= dt.min() + 1 / rate_hz)
    return int(again.sum())


def reobserved_points(obs: Observations, rate_hz: float) -> int:
    """Number of landmarks observed again after half a revolution or more, or over a whole revolution."""
    dt, first = obs.rows.dt, obs.rows.first
    hidden = np.zeros(obs.points, bool)
    np.logical_or.at(hidden, obs.point_index()[1:], (np.diff(dt) >= 0.5 / rate_hz) & (np.diff(obs.point_index()) == 0))
    return int((hidden | (dt[first[1:] - 1] - dt[first[:-1]] >= 1 / rate_hz)).sum())
