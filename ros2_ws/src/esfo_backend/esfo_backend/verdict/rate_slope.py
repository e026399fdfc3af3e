"""Whether the rate is constant: the orbit model with one more parameter, a slope of the rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution
from esfo_backend.adjustment.consider_bias import SLOPE, gauss_newton
from esfo_backend.orbit.observations import Observations


@dataclass(frozen=True)
class RateSlope:
    """Slope of the rate with its standard deviation, Hz per second.

    widened: by which factor the deviation is larger than for landmarks that share no errors at the same time.
    """

    slope: float
    std: float
    widened: float = 1.0

    @property
    def significance(self) -> float:
        """Slope in standard deviations that are not widened.

        What a constant rate leaves unexplained of a changing one is shared by all landmarks, and must not hide it.
        """
        return abs(self.slope) / self.std * self.widened if self.std > 0 else np.inf


def rate_slope(solution: OrbitSolution, obs: Observations, cauchy_px: float, bias_px: float = 0.0) -> RateSlope:
    """Estimate the slope g in theta = 2 pi (f dt + g dt^2 / 2) by one Gauss-Newton step from the constant-rate optimum.

    Motion and points are free in the step, so that only what they cannot explain is attributed to the slope. The
    standard deviation is that of `gauss_newton`.
    """
    found = gauss_newton(solution, obs, cauchy_px, np.arange(SLOPE + 1), bias_px)
    std, alone = np.sqrt([found.covariance[SLOPE, SLOPE], found.independent[SLOPE, SLOPE]])
    return RateSlope(float(found.step[SLOPE]), float(std), float(std / alone) if alone > 0 else 1.0)
