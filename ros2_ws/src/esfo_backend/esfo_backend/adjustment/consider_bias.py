"""The orbit problem, points eliminated, with what else may move residuals: slope of the rate, bias of corners.

The corners of the front-end are not exactly points of the object. Part of that error is common to all of them: they
trail their point, and lie inside or outside of its corner, as the image motion and the side from which it is seen
decide. No residual shows the part that the axis can absorb, so its deviation is to be added by its size.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_backend.adjustment.elimination import factor_landmark, solve_lower
from esfo_backend.orbit.observations import ObservationRows
from esfo_backend.orbit.projection import cauchy_weight, linearize_row
from esfo_core.orbit import Matrix

MOTION = slice(0, 4)
"""Right rotation vector of Q, rate."""
SLOPE = 4
"""Slope of the rate, Hz per second."""
BIAS = slice(5, 9)
"""Bias of corners, px: along and across the image motion, and both in proportion to the side from which a point is seen
(1 where it comes into view, 0 where it is nearest, -1 where it leaves)."""
COLUMNS = 9


@njit(cache=True, nogil=True)
def reduced_equations(
    Q: Matrix, rate: float, y: Matrix, rows: ObservationRows, cauchy: float, power: int
) -> tuple[NDArray[np.float64], Matrix]:
    """Information (P, 9, 9) and score (P, 9) that each landmark gives of the columns above, itself eliminated.

    Rows weigh by Cauchy's weight^power at the residuals, with power as in `normal_equations`; rows behind the camera
    count nothing.
    """
    P = len(rows.first) - 1
    information, score = np.zeros((P, COLUMNS, COLUMNS)), np.zeros((P, COLUMNS))
    block, wide, full = np.empty((2, 8)), np.empty((2, 13)), np.empty((13, 13))
    L, Z = np.zeros((3, 3)), np.empty((10, 3))
    for j in range(P):
        full[:] = 0.0
        for k in range(rows.first[j], rows.first[j + 1]):
            if not linearize_row(Q, rate, y[j], rows, k, block):
                continue
            _widen(rate, y[j], rows, k, block, wide)
            w = cauchy_weight(block, cauchy) ** power
            for m in range(13):
                for n in range(13):
                    full[m, n] += w * (wide[0, m] * wide[0, n] + wide[1, m] * wide[1, n])
        factor_landmark(full[10:, 10:], 0.0, L)
        for m in range(10):
            solve_lower(L, full[m, 10:], Z[m])
        for m in range(COLUMNS):
            score[j, m] = full[1 + m, 0] - np.dot(Z[1 + m], Z[0])
            for n in range(COLUMNS):
                information[j, m, n] = full[1 + m, 1 + n] - np.dot(Z[1 + m], Z[1 + n])
    return information, score


@njit(cache=True, nogil=True)
def _widen(rate: float, y: NDArray[np.floating], rows: ObservationRows, k: int, block: Matrix, wide: Matrix) -> None:
    """Write residual, motion, slope, bias and point columns of row k into wide (2, 13).

    block: of `linearize_row`. The direction of the image motion is the derivative by y along the point's own velocity.
    """
    theta = 2 * np.pi * rate * rows.dt[k]
    across = np.cos(theta) * y[1] - np.sin(theta) * y[0]
    side = across / max(np.hypot(y[0], y[1]), 1e-12)
    u = block[0, 5] * y[1] - block[0, 6] * y[0]
    v = block[1, 5] * y[1] - block[1, 6] * y[0]
    speed = max(np.hypot(u, v), 1e-12)
    u, v = u / speed, v / speed
    weight = rows.weight[k]
    for i in range(2):
        wide[i, :5] = block[i, :5]
        wide[i, 5] = block[i, 4] * rows.dt[k] / 2
        wide[i, 10:] = block[i, 5:]
    for i, along, aside in ((0, u, -v), (1, v, u)):
        wide[i, 6], wide[i, 7] = weight * along, weight * aside
        wide[i, 8], wide[i, 9] = weight * along * side, weight * aside * side


def bias_sensitivity(information: Matrix, solved: NDArray[np.int64]) -> Matrix:
    """How much the columns `solved` (S,) move for a bias of 1 px of each kind, (S, 4), when they alone are estimated.

    information: (9, 9), summed over points.
    """
    return solve_scaled(information[np.ix_(solved, solved)], information[solved, BIAS])


def solve_scaled(information: Matrix, right: Matrix) -> Matrix:
    """Solve symmetric equations whose unknowns have very different units; what is not determined stays 0."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True)
    return np.asarray(inverse @ (right / scale[:, None]) / scale[:, None])


def gauss_newton(
    equations: tuple[NDArray[np.float64], Matrix], solved: NDArray[np.int64], bias_px: float
) -> tuple[NDArray[np.float64], Matrix]:
    """One step of the columns `solved` (S,) from the optimum, and its covariance (S, S).

    equations: of `reduced_equations`. The covariance treats only points as independent (sandwich estimator, clusters =
    points) and adds a common bias of corners of bias_px.
    """
    every, scores = equations[0], equations[1][:, solved]
    information = every.sum(axis=0)
    parts = every[:, solved[:, None], solved]
    inverse = solve_scaled(information[np.ix_(solved, solved)], np.eye(len(solved)))
    step = -inverse @ scores.sum(axis=0)
    left = scores + parts @ step  # what the residuals still say after the step: a drift is no noise
    small_sample = len(parts) / max(len(parts) - len(solved), 1)
    biased = bias_px * bias_sensitivity(information, solved)
    return step, small_sample * inverse @ (left.T @ left) @ inverse + biased @ biased.T
