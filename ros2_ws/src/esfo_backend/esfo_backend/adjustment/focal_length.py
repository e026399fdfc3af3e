"""Focal length of a camera that was not calibrated: a parameter with a wide prior, estimated where the orbit shows it.

The near side of a turning object is larger and moves faster than the far side by as much as the object is deep for its
distance; an image of the same size behind another lens is of another distance. Without such perspective the focal
length stays what it was assumed to be, with the deviation of the prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution, bundle_adjustment, linear_points
from esfo_backend.adjustment.consider_bias import COLUMNS, FOCAL, MOTION, gauss_newton
from esfo_backend.orbit.observations import Observations
from esfo_core.camera import Camera

_SOLVED = np.append(np.arange(COLUMNS)[MOTION], FOCAL)
_ITERATIONS = 20
_LARGEST_STEP = 0.2
_NEAR = 0.05
"""Step, in deviations of the estimate, that is too small to be taken."""


@dataclass(frozen=True)
class FocalEstimate:
    """The camera with its estimated focal length, `focal_std` of it being what is left; solution and rows for it."""

    camera: Camera
    solution: OrbitSolution
    obs: Observations


def estimate_focal(
    solution: OrbitSolution, obs: Observations, assumed: Camera, cauchy_px: float, bias_px: float
) -> FocalEstimate:
    """Maximise the posterior over the focal length, everything else adjusted at each value.

    solution, obs: an optimum at any focal length. assumed: its focal length and `focal_std` are mean and deviation of
    the prior, of the logarithm. The likelihood is that of `gauss_newton`: its deviation knows of errors that landmarks
    and times share, and of a common bias of corners.
    """
    prior = assumed.focal_std**2
    largest, before = _LARGEST_STEP, 0.0
    for _ in range(_ITERATIONS):
        found = gauss_newton(solution, obs, cauchy_px, _SOLVED, bias_px)
        off = float(np.log(obs.rows.focal[0] / assumed.K[0, 0]))
        variance = float(found.covariance[-1, -1])
        kept = prior / (prior + variance) if np.isfinite(variance) else 0.0
        std = float(np.sqrt(prior * (1 - kept)))
        move = kept * (off + float(found.step[-1])) - off if kept else -off
        if abs(move) < _NEAR * std:
            break
        if move * before < 0:
            largest /= 2
        before = move
        obs = with_focal(obs, float(np.exp(np.clip(move, -largest, largest))))
        solution = bundle_adjustment(solution.motion, linear_points(solution.motion, obs), obs, cauchy_px)
    focal_px = assumed.focal_px * float(obs.rows.focal[0] / assumed.K[0, 0])
    return FocalEstimate(assumed.with_focal(focal_px, std), solution, obs)


def with_focal(obs: Observations, factor: float) -> Observations:
    """Return the same pixels, seen through a lens of `factor` times the focal length."""
    rows = obs.rows._replace(xy=obs.rows.xy / factor, focal=obs.rows.focal * factor)
    return replace(obs, rows=rows)
