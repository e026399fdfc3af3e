"""Covariance of the motion, for errors that are correlated along a track or common to all tracks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution
from esfo_backend.adjustment.common_errors import Timeline, common_variance
from esfo_backend.adjustment.consider_bias import (
    BIAS,
    COLUMNS,
    FOCAL,
    MOTION,
    reduced_equations,
    row_scores,
    sensitivity,
)
from esfo_backend.orbit.observations import Observations
from esfo_backend.orbit.projection import row_errors
from esfo_core.orbit import Matrix, tangent_basis

_MOTION_PARAMETERS = 4
CONSIDERED = np.append(np.arange(COLUMNS)[BIAS], FOCAL)


@dataclass(frozen=True)
class MotionCovariance:
    """rate_std_hz and the covariance (2, 2) of the axis in rad^2 in `tangent_basis(axis)`."""

    rate_std_hz: float
    axis_cov: Matrix


def motion_covariance(
    solution: OrbitSolution,
    obs: Observations,
    marginal: Matrix,
    cauchy_px: float,
    bias_px: float = 0.0,
    focal_std: float = 0.0,
) -> MotionCovariance:
    """Scale the graph's marginal covariance by the variance of the residuals.

    marginal: (4, 4) for residuals of unit variance. Two estimates are made: for independent residuals of one variance,
    and for residuals that are independent between landmarks only (sandwich estimator, clusters = landmarks), because
    errors are correlated along a track, and that landmarks may share at the same time (`common_variance`), as with a
    camera that trembles. The larger variance of each parameter is kept, because the sandwich estimate is noisy for few
    landmarks. A bias of corners of standard deviation bias_px, common to all landmarks, is added as in a
    Schmidt-Kalman filter (its parameters are considered, not estimated), and so is a focal length of relative standard
    deviation focal_std. NaN where the marginal is.
    """
    motion = solution.motion
    information, scores = reduced_equations(motion.Q, motion.rate_hz, solution.y, obs.rows, cauchy_px, 1)
    score = scores[:, MOTION]
    small_sample = obs.points / max(obs.points - _MOTION_PARAMETERS, 1)
    sandwich = small_sample * np.diag(marginal @ (score.T @ score) @ marginal)
    nothing = np.zeros(COLUMNS)
    influence = row_scores(motion.Q, motion.rate_hz, solution.y, obs.rows, cauchy_px, nothing)[:, MOTION] @ marginal
    sandwich = sandwich + common_variance(influence, Timeline(obs.rows.dt, obs.rows.first, motion.rate_hz))
    independent = _independent_variance(solution, obs, cauchy_px) * marginal
    ratio = np.sqrt(np.maximum(sandwich / np.maximum(np.diag(independent), 1e-300), 1.0))
    cov = independent * np.outer(ratio, ratio)
    moved = sensitivity(information.sum(axis=0), np.arange(_MOTION_PARAMETERS), CONSIDERED)
    moved = moved * np.append(np.full(len(CONSIDERED) - 1, bias_px), focal_std)
    cov = cov + moved @ moved.T
    # A right rotation vector d of Q moves the axis by -Q (d x e_z) = Q (-d_y, d_x, 0).
    to_tangent = tangent_basis(motion.axis).T @ motion.Q @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]])
    return MotionCovariance(float(np.sqrt(cov[3, 3])), to_tangent @ cov[:3, :3] @ to_tangent.T)


def _independent_variance(solution: OrbitSolution, obs: Observations, cauchy_px: float) -> float:
    """Variance factor in px^2 of an M-estimate: mean squared influence over the square of the mean curvature."""
    errors = obs.rows.weight * row_errors(solution.motion.Q, solution.motion.rate_hz, solution.y, obs.rows)
    errors = errors[np.isfinite(errors)]
    w = 1 / (1 + (errors / cauchy_px) ** 2) if cauchy_px > 0 else np.ones_like(errors)
    freedom = max(2 * len(errors) - 3 * obs.points - _MOTION_PARAMETERS, 1)
    return float(((w * errors) ** 2).sum() / freedom * len(errors) / max((w**2).sum(), 1e-300))


def schur_marginal(solution: OrbitSolution, obs: Observations, cauchy_px: float) -> Matrix:
    """Marginal covariance (4, 4) of (rotation vector of Q, rate) as from the factor graph; NaN where indeterminate."""
    motion = solution.motion
    information, _ = reduced_equations(motion.Q, motion.rate_hz, solution.y, obs.rows, cauchy_px, 2)
    try:
        return np.asarray(np.linalg.inv(information.sum(axis=0)[MOTION, MOTION]))
    except np.linalg.LinAlgError:
        return np.full((4, 4), np.nan)
