"""Whether the rate is constant: the orbit model with one more parameter, a slope of the rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esfo_backend.adjust import Adjusted
from esfo_backend.nuisance import SLOPE, bias_sensitivity, reduced_equations, solve_scaled
from esfo_backend.problem import Observations

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


def rate_drift(solution: Adjusted, obs: Observations, cauchy_px: float, bias_px: float = 0.0) -> RateDrift:
    """Estimate the slope g in theta = 2 pi (f dt + g dt^2 / 2) by one Gauss-Newton step from the constant-rate optimum.

    Motion and points are free in the step, so that nothing they could explain is taken for a drift. The deviation
    treats only points as independent (sandwich estimator, clusters = points), and adds the bias of corners of bias_px.
    """
    motion = solution.motion
    every, scores = reduced_equations(motion.Q, motion.rate_hz, solution.y, obs.rows, cauchy_px)
    parts, scores = every[:, :_PARAMETERS, :_PARAMETERS], scores[:, :_PARAMETERS]
    information = every.sum(axis=0)
    inverse = solve_scaled(information[:_PARAMETERS, :_PARAMETERS], np.eye(_PARAMETERS))
    step = -inverse @ scores.sum(axis=0)
    left = scores + parts @ step  # what the residuals still say after the step: a drift is no noise
    small_sample = obs.points / max(obs.points - _PARAMETERS, 1)
    covariance = small_sample * inverse @ (left.T @ left) @ inverse
    biased = bias_px * bias_sensitivity(information, _PARAMETERS)[SLOPE]
    return RateDrift(float(step[SLOPE]), float(np.sqrt(covariance[SLOPE, SLOPE] + biased @ biased)))
