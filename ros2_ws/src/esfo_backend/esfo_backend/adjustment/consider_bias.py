"""Normal equations of the orbit, landmarks eliminated, extended by the rate slope and the bias of corners.

The corners of the front-end are not exactly points of the object. Part of that error is common to all of them: they
lag behind their point, and lie inside or outside of the object's corner, depending on the image motion and the viewing
side. The residuals do not show the part that a change of the axis compensates, so its covariance is added.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution
from esfo_backend.adjustment.common_errors import Timeline, common_variance
from esfo_backend.adjustment.elimination import factor_landmark, solve_lower
from esfo_backend.orbit.observations import ObservationRows, Observations
from esfo_backend.orbit.projection import cauchy_weight, linearize_row
from esfo_core.orbit import Matrix, Vector

MOTION = slice(0, 4)
"""Right rotation vector of Q, rate."""
SLOPE = 4
"""Slope of the rate, Hz per second."""
BIAS = slice(5, 9)
"""Bias of corners, px: along and across the image motion, and both in proportion to the side from which a point is seen
(1 where it comes into view, 0 where it is nearest, -1 where it leaves)."""
FOCAL = 9
"""Logarithm of the focal length: both focal lengths change by the same factor, and the directions of all rows with
them."""
COLUMNS = 10
_WIDE = 1 + COLUMNS + 3
"""Columns of a row: the residual, those above, the point."""


@njit(cache=True, nogil=True)
def reduced_equations(
    Q: Matrix, rate: float, y: Matrix, rows: ObservationRows, cauchy: float, power: int
) -> tuple[NDArray[np.float64], Matrix]:
    """Information (P, 10, 10) and score (P, 10) that each landmark gives of the columns above, itself eliminated.

    Weights are Cauchy's weight^power at the residuals, with power as in `normal_equations`; observations behind the
    camera are left out.
    """
    P = len(rows.first) - 1
    information, score = np.zeros((P, COLUMNS, COLUMNS)), np.zeros((P, COLUMNS))
    block, wide, full = np.empty((2, 8)), np.empty((2, _WIDE)), np.empty((_WIDE, _WIDE))
    L, Z = np.zeros((3, 3)), np.empty((1 + COLUMNS, 3))
    for j in range(P):
        full[:] = 0.0
        for k in range(rows.first[j], rows.first[j + 1]):
            if not linearize_row(Q, rate, y[j], rows, k, block):
                continue
            _widen(rate, y[j], rows, k, block, wide)
            w = cauchy_weight(block, cauchy) ** power
            for m in range(_WIDE):
                for n in range(_WIDE):
                    full[m, n] += w * (wide[0, m] * wide[0, n] + wide[1, m] * wide[1, n])
        factor_landmark(full[1 + COLUMNS :, 1 + COLUMNS :], 0.0, L)
        for m in range(1 + COLUMNS):
            solve_lower(L, full[m, 1 + COLUMNS :], Z[m])
        for m in range(COLUMNS):
            score[j, m] = full[1 + m, 0] - np.dot(Z[1 + m], Z[0])
            for n in range(COLUMNS):
                information[j, m, n] = full[1 + m, 1 + n] - np.dot(Z[1 + m], Z[1 + n])
    return information, score


@njit(cache=True, nogil=True)
def row_scores(Q: Matrix, rate: float, y: Matrix, rows: ObservationRows, cauchy: float, step: Vector) -> Matrix:
    """Parts (N, 10) of the score that the rows give of the columns above, their landmarks eliminated.

    step: (10,) of the columns; the residuals are those that are left after it. Summed over the rows of a landmark they
    are its score of `reduced_equations` with power 1, plus its information times the step.
    """
    out = np.zeros((len(rows.dt), COLUMNS))
    block, wide, own, left = np.empty((2, 8)), np.empty((2, _WIDE)), np.empty(3), np.empty(1 + COLUMNS)
    L, Z = np.zeros((3, 3)), np.empty((1 + COLUMNS, 3))
    for j in range(len(rows.first) - 1):
        _factor_point(Q, rate, y[j], rows, (rows.first[j], rows.first[j + 1], cauchy), L, Z)
        for k in range(rows.first[j], rows.first[j + 1]):
            if not linearize_row(Q, rate, y[j], rows, k, block):
                continue
            _widen(rate, y[j], rows, k, block, wide)
            w = cauchy_weight(block, cauchy)
            for i in range(2):
                solve_lower(L, wide[i, 1 + COLUMNS :], own)
                for m in range(1 + COLUMNS):
                    left[m] = wide[i, m] - np.dot(Z[m], own)
                residual = left[0] + np.dot(left[1:], step)
                for m in range(COLUMNS):
                    out[k, m] += w * left[1 + m] * residual
    return out


@njit(cache=True, nogil=True)
def _factor_point(
    Q: Matrix, rate: float, y: Vector, rows: ObservationRows, part: tuple[int, int, float], L: Matrix, Z: Matrix
) -> None:
    """Cholesky factor L (3, 3) of the information of a point, and L^-1 times that of it with the columns, Z (11, 3).

    part: its rows, begin and end, and the scale of Cauchy's function.
    """
    point, mixed = np.zeros((3, 3)), np.zeros((1 + COLUMNS, 3))
    block, wide = np.empty((2, 8)), np.empty((2, _WIDE))
    for k in range(part[0], part[1]):
        if not linearize_row(Q, rate, y, rows, k, block):
            continue
        _widen(rate, y, rows, k, block, wide)
        w = cauchy_weight(block, part[2])
        for i in range(2):
            for n in range(3):
                p = w * wide[i, 1 + COLUMNS + n]
                for m in range(3):
                    point[m, n] += p * wide[i, 1 + COLUMNS + m]
                for m in range(1 + COLUMNS):
                    mixed[m, n] += p * wide[i, m]
    factor_landmark(point, 0.0, L)
    for m in range(1 + COLUMNS):
        solve_lower(L, mixed[m], Z[m])


@njit(cache=True, nogil=True)
def _widen(rate: float, y: NDArray[np.floating], rows: ObservationRows, k: int, block: Matrix, wide: Matrix) -> None:
    """Write residual, motion, slope, bias, focal and point columns of row k into wide (2, 14).

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
        wide[i, 10] = block[i, 0] + rows.focal[i] * weight * rows.xy[k, i]
        wide[i, 11:] = block[i, 5:]
    for i, along, aside in ((0, u, -v), (1, v, u)):
        wide[i, 6], wide[i, 7] = weight * along, weight * aside
        wide[i, 8], wide[i, 9] = weight * along * side, weight * aside * side


def sensitivity(information: Matrix, solved: NDArray[np.int64], considered: NDArray[np.int64]) -> Matrix:
    """Derivative (S, C) of the estimated columns `solved` (S,) by the columns `considered` (C,).

    information: (10, 10), summed over points. The columns `solved` alone are estimated.
    """
    return solve_scaled(information[np.ix_(solved, solved)], information[np.ix_(solved, considered)])


def solve_scaled(information: Matrix, right: Matrix) -> Matrix:
    """Solve symmetric equations of unknowns in different units; undetermined unknowns are 0."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True)
    return np.asarray(inverse @ (right / scale[:, None]) / scale[:, None])


class GaussNewtonStep(NamedTuple):
    """A step (S,) from an optimum and its covariance (S, S).

    independent: the covariance if landmarks shared no errors at the same time.
    """

    step: Vector
    covariance: Matrix
    independent: Matrix


def gauss_newton(
    solution: OrbitSolution, obs: Observations, cauchy_px: float, solved: NDArray[np.int64], bias_px: float
) -> GaussNewtonStep:
    """One step of the columns `solved` (S,) from an optimum.

    The covariance treats only landmarks as independent (sandwich estimator, clusters = landmarks), is widened by the
    errors that they share at the same time (`common_variance`), and a common bias of corners of bias_px is added.
    """
    motion, rows = solution.motion, obs.rows
    every, scores = reduced_equations(motion.Q, motion.rate_hz, solution.y, rows, cauchy_px, 1)
    information, scores = every.sum(axis=0), scores[:, solved]
    inverse = solve_scaled(information[np.ix_(solved, solved)], np.eye(len(solved)))
    step = -inverse @ scores.sum(axis=0)
    # What the residuals still say after the step: a drift is no noise.
    left = scores + every[:, solved[:, None], solved] @ step
    small_sample = obs.points / max(obs.points - len(solved), 1)
    independent = small_sample * inverse @ (left.T @ left) @ inverse
    whole = np.zeros(COLUMNS)
    whole[solved] = step
    influence = row_scores(motion.Q, motion.rate_hz, solution.y, rows, cauchy_px, whole)[:, solved] @ inverse
    shared = common_variance(influence, Timeline(rows.dt, rows.first, motion.rate_hz))
    ratio = np.sqrt(1 + shared / np.maximum(np.diag(independent), 1e-300))
    biased = bias_px * sensitivity(information, solved, np.arange(COLUMNS)[BIAS])
    bias = biased @ biased.T
    return GaussNewtonStep(step, independent * np.outer(ratio, ratio) + bias, independent + bias)
