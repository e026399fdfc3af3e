"""Whether the rate is constant: the orbit model with one more parameter, a slope of the rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esfo_backend.adjust import Adjusted
from esfo_backend.problem import Observations
from esfo_backend.projection import linearize_stack

_PARAMETERS = 5


@dataclass(frozen=True)
class RateDrift:
    """Slope of the rate with its standard deviation, Hz per second."""

    slope: float
    std: float

    @property
    def significance(self) -> float:
        """Slope in standard deviations."""
        return abs(self.slope) / self.std if self.std > 0 else np.inf


def rate_drift(solution: Adjusted, obs: Observations, cauchy_px: float) -> RateDrift:
    """Estimate the slope g in theta = 2 pi (f dt + g dt^2 / 2) by one Gauss-Newton step from the constant-rate optimum.

    Motion and points are free in the step, so that nothing they could explain is taken for a drift. The deviation
    treats only points as independent (sandwich estimator, clusters = points).
    """
    parts, scores = np.zeros((obs.points, _PARAMETERS, _PARAMETERS)), np.zeros((obs.points, _PARAMETERS))
    Q, rate = solution.motion.Q, solution.motion.rate_hz
    for j in range(obs.points):
        own = obs.of_point(j)
        J = linearize_stack(Q, rate, solution.y[j], own, cauchy_px, 1)
        r, point = J[:, 0], J[:, 5:8]
        motion = np.column_stack([J[:, 1:5], J[:, 4] * np.repeat(own.dt, 2) / 2])
        reduced = motion - point @ (np.linalg.pinv(point.T @ point, hermitian=True) @ (point.T @ motion))
        parts[j] = reduced.T @ motion
        scores[j] = reduced.T @ r
    information = parts.sum(axis=0)
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))  # the parameters have very different units
    inverse = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
    step = -inverse @ scores.sum(axis=0)
    left = scores + parts @ step  # what the residuals still say after the step: a drift is no noise
    small_sample = obs.points / max(obs.points - _PARAMETERS, 1)
    covariance = small_sample * inverse @ (left.T @ left) @ inverse
    return RateDrift(float(step[4]), float(np.sqrt(covariance[4, 4])))
