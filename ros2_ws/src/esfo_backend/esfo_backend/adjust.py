"""Bundle adjustment of the orbit by Levenberg-Marquardt with the points eliminated (Schur complement)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_backend.problem import Motion, Observations, Rows
from esfo_backend.projection import cauchy_weight, linearize_row, robust_cost, triangulate
from esfo_core.orbit import Matrix

Blocks = NDArray[np.float64]


@dataclass(frozen=True)
class Adjusted:
    """Result of an adjustment: motion, points y (P, 3), robust cost in px^2, iterations used."""

    motion: Motion
    y: Matrix
    cost: float
    iterations: int


class NormalEquations(NamedTuple):
    """J^T W J and J^T W r by blocks: m is the motion (Q, rate), p a point.

    mm: (4, 4). m: (P, 4), kept per point because the covariance needs the score of each. mp: (P, 4, 3).
    pp: (P, 3, 3). p: (P, 3).
    """

    mm: Matrix
    m: Matrix
    mp: Blocks
    pp: Blocks
    p: Matrix


@njit(cache=True, nogil=True)
def normal_equations(Q: Matrix, rate: float, y: Matrix, rows: Rows, cauchy: float, power: int) -> NormalEquations:
    """Accumulate the normal equations with Cauchy weights w^power.

    power 1 gives the equations of the iteration (IRLS); power 2 the mean second derivative of Cauchy's function for an
    isotropic residual, which is what a covariance needs.
    """
    P = len(rows.first) - 1
    mm, gm = np.zeros((4, 4)), np.zeros((P, 4))
    mp, pp, gp = np.zeros((P, 4, 3)), np.zeros((P, 3, 3)), np.zeros((P, 3))
    out, full = np.empty((2, 8)), np.empty((8, 8))
    for j in range(P):
        full[:] = 0.0
        for k in range(rows.first[j], rows.first[j + 1]):
            if linearize_row(Q, rate, y[j], rows, k, out):
                w = cauchy_weight(out, cauchy) ** power
                for m in range(8):
                    for n in range(8):
                        full[m, n] += w * (out[0, m] * out[0, n] + out[1, m] * out[1, n])
        mm += full[1:5, 1:5]
        gm[j], gp[j] = full[1:5, 0], full[5:, 0]
        mp[j], pp[j] = full[1:5, 5:], full[5:, 5:]
    return NormalEquations(mm, gm, mp, pp, gp)


@njit(cache=True, nogil=True)
def _expmap(v: NDArray[np.floating]) -> Matrix:
    angle = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    K = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    R: Matrix = np.eye(3) + K
    if angle > 1e-12:
        R = np.eye(3) + np.sin(angle) / angle * K + (1 - np.cos(angle)) / (angle * angle) * (K @ K)
    return R


@njit(cache=True, nogil=True)
def _step(H: NormalEquations, damping: float, free_rate: bool) -> tuple[NDArray[np.floating], Matrix]:
    """Solve the damped normal equations; returns the motion step (4,) and the point steps (P, 3)."""
    P = len(H.p)
    S, b = H.mm.copy(), np.zeros(4)
    inverse = np.empty((P, 3, 3))
    for m in range(4):
        S[m, m] += damping * H.mm[m, m] + 1e-12
    for j in range(P):
        D = H.pp[j].copy()
        for m in range(3):
            D[m, m] += damping * D[m, m] + 1e-9
        inverse[j] = np.linalg.inv(D)
        G = H.mp[j] @ inverse[j]
        S -= G @ H.mp[j].T
        b -= H.m[j] - G @ H.p[j]
    if not free_rate:
        S[3, :] = 0.0
        S[:, 3] = 0.0
        S[3, 3] = 1.0
        b[3] = 0.0
    dm = np.linalg.solve(S, b)
    dp = np.empty((P, 3))
    for j in range(P):
        dp[j] = -inverse[j] @ (H.p[j] + H.mp[j].T @ dm)
    return dm, dp


@njit(cache=True, nogil=True)
def _levenberg_marquardt(
    Q: Matrix, rate: float, y: Matrix, rows: Rows, cauchy: float, limits: tuple[bool, int, float]
) -> tuple[Matrix, float, Matrix, float, int]:
    free_rate, iterations, tolerance = limits
    cost = robust_cost(Q, rate, y, rows, cauchy)
    damping = 1e-4
    used = 0
    while used < iterations:
        used += 1
        H = normal_equations(Q, rate, y, rows, cauchy, 1)
        gain = 0.0
        for _ in range(10):
            dm, dp = _step(H, damping, free_rate)
            trial_Q, trial_rate, trial_y = Q @ _expmap(dm[:3]), rate + dm[3], y + dp
            trial = robust_cost(trial_Q, trial_rate, trial_y, rows, cauchy)
            if trial < cost:
                gain = cost - trial
                Q, rate, y, cost = trial_Q, trial_rate, trial_y, trial
                damping = max(damping / 5, 1e-12)
                break
            damping *= 8
        if gain <= tolerance * cost:
            break
    return Q, rate, y, cost, used


def linear_points(motion: Motion, obs: Observations) -> Matrix:
    """Best points (P, 3) for a given motion, by linear least squares."""
    return np.asarray(triangulate(motion.Q, motion.rate_hz, obs.rows))


def adjust(
    motion: Motion,
    y: Matrix,
    obs: Observations,
    cauchy_px: float,
    free_rate: bool = True,
    iterations: int = 50,
) -> Adjusted:
    """Minimise the robust reprojection error over Q, the rate (if free) and all points.

    cauchy_px: scale of Cauchy's function, <= 0 for plain least squares. Stops when a step gains less than 1e-10 of the
    cost.
    """
    Q, rate, points, cost, used = _levenberg_marquardt(
        np.ascontiguousarray(motion.Q),
        float(motion.rate_hz),
        np.ascontiguousarray(y),
        obs.rows,
        float(cauchy_px),
        (free_rate, iterations, 1e-10),
    )
    U, _, Vt = np.linalg.svd(Q)  # rounding of many small rotations
    return Adjusted(Motion(U @ Vt, float(rate)), points, float(cost), int(used))
