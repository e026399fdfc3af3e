"""From one point per track to the points of the object: re-identification, then pruning of what is no fixed point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esfo_backend.adjust import Adjusted, adjust
from esfo_backend.errors import BackendError
from esfo_backend.options import BackendOptions
from esfo_backend.problem import Observations
from esfo_backend.projection import row_errors
from esfo_backend.reidentify import ROUND_ITERATIONS, Labels, point_rms, reidentify
from esfo_backend.start import Start

_PRUNING_ROUNDS = 2


@dataclass(frozen=True)
class Structure:
    """One point per label: the observations of each, the solution, and the point (M,) of each track, -1 for none."""

    obs: Observations
    solution: Adjusted
    label: Labels


def build_structure(start: Start, obs: Observations, options: BackendOptions) -> Structure:
    """Re-identify with the rate held, then free, then tighten the loss: the order that was measured best.

    obs: one point per track (M).
    """
    loose, tight = options.start.cauchy_px, options.graph.cauchy_px
    solution, label = start.adjusted, np.arange(obs.points)
    if not options.reidentification.enabled:
        return Structure(obs, solution, label)
    solution, label = reidentify(solution, obs, label, options.reidentification, loose, False)
    solution = adjust(solution.motion, solution.y, obs.regroup(label), loose, iterations=ROUND_ITERATIONS)
    solution, label = reidentify(solution, obs, label, options.reidentification, loose, True)
    grouped = obs.regroup(label)
    solution = adjust(solution.motion, solution.y, grouped, tight, iterations=ROUND_ITERATIONS)
    return Structure(grouped, solution, label)


def prune(structure: Structure, options: BackendOptions) -> Structure:
    """Drop what is no fixed point of the object (silhouettes, false tracks), refit, and look once more.

    Raises BackendError when too few points are left.
    """
    limit_px, needed = options.graph.prune_px, options.verdict.min_points
    for _ in range(_PRUNING_ROUNDS):
        motion, y = structure.solution.motion, structure.solution.y
        errors = row_errors(motion.Q, motion.rate_hz, y, structure.obs.rows)
        middle = np.array([0.0, 0.0, np.median(y[:, 2])])
        # The camera, at distance |(1, middle)| from the middle of the object, is outside the object.
        near = np.linalg.norm(y - middle, axis=1) < np.hypot(1.0, middle[2])
        keep = (point_rms(errors, structure.obs) < limit_px) & near
        if keep.sum() < needed:
            raise BackendError(
                f"only {int(keep.sum())} of {len(keep)} points follow one rotation to {limit_px} px; "
                f"{needed} are needed",
                "too_few_points",
            )
        new_label = np.where(keep, np.cumsum(keep) - 1, -1)
        obs = structure.obs.regroup(new_label)
        solution = adjust(motion, y[keep], obs, options.graph.cauchy_px)
        label = np.where(structure.label >= 0, new_label[structure.label], -1)
        structure = Structure(obs, solution, label)
    return structure


def repeatable_points(obs: Observations, rate_hz: float) -> int:
    """Number of points that were seen a turn or more before the end, or after the beginning, of the observations."""
    dt, first = obs.rows.dt, obs.rows.first
    again = (dt[first[:-1]] <= dt.max() - 1 / rate_hz) | (dt[first[1:] - 1] >= dt.min() + 1 / rate_hz)
    return int(again.sum())


def recurring_points(obs: Observations, rate_hz: float) -> int:
    """Number of points that were seen again after half a turn or more without being seen."""
    dt, first = obs.rows.dt, obs.rows.first
    half_turn = 0.5 / rate_hz
    return sum(bool(np.diff(dt[first[j] : first[j + 1]]).max(initial=0.0) >= half_turn) for j in range(obs.points))
