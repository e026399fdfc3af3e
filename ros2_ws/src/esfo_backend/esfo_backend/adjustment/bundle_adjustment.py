"""Bundle adjustment of the orbit by Levenberg-Marquardt with the landmarks eliminated (Schur complement)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_backend.adjustment.elimination import factor_landmark, solve_lower
from esfo_backend.orbit.observations import ObservationRows, Observations
from esfo_backend.orbit.parametrization import Motion
from esfo_backend.orbit.projection import BEHIND_CAMERA_COST, cauchy_weight, linearize_row, triangulate
from esfo_core.orbit import Matrix

Blocks = NDArray[np.float64]

_LARGEST_PRODUCT = 1e200
_RELATIVE_GAIN = 1e-10


@dataclass(frozen=True)
class OrbitSolution:
    """Result of a bundle adjustment: motion, landmarks y (P, 3), robust cost in px^2, iterations used."""

    motion: Motion
    y: Matrix
    cost: float
    iterations: int


class NormalEquations(NamedTuple):
    """Blocks of J^T W J and J^T W r, and the cost at the same values: m is the motion (Q, rate), p a landmark.

    mm: (4, 4). m: (P, 4), the score of each landmark. mp: (P, 4, 3).
    pp: (P, 3, 3). p: (P, 3). cost: that of `robust_cost`, px^2.
    """

    mm: Matrix
    m: Matrix
    mp: Blocks
    pp: Blocks
    p: Matrix
    cost: float


@njit(cache=True, nogil=True)
def normal_equations(
    Q: Matrix, rate: float, y: Matrix, rows: ObservationRows, cauchy: float, power: int
) -> NormalEquations:
    """Accumulate the normal equations with Cauchy weights w^power, and the robust cost in the same pass.

    power 1 gives the equations of the iteration (IRLS); power 2 the mean second derivative of Cauchy's function for an
    isotropic residual, which is what a covariance needs.
    """
    P = len(rows.first) - 1
    mm, gm = np.zeros((4, 4)), np.zeros((P, 4))
    mp, pp, gp = np.zeros((P, 4, 3)), np.zeros((P, 3, 3)), np.zeros((P, 3))
    out, full = np.empty((2, 8)), np.empty((8, 8))
    cost = 0.0
    for j in range(P):
        full[:] = 0.0
        product = 1.0  # of 1 / w: one logarithm for many rows
        for k in range(rows.first[j], rows.first[j + 1]):
            if not linearize_row(Q, rate, y[j], rows, k, out):
                cost += BEHIND_CAMERA_COST
                continue
            w = cauchy_weight(out, cauchy)
            product /= w
            if cauchy <= 0:
                cost += 0.5 * (out[0, 0] * out[0, 0] + out[1, 0] * out[1, 0])
            elif product > _LARGEST_PRODUCT:
                cost += 0.5 * cauchy * cauchy * np.log(product)
                product = 1.0
            w = w**power
            for m in range(8):
                a, b = w * out[0, m], w * out[1, m]
                for n in range(8):
                    full[m, n] += a * out[0, n] + b * out[1, n]
        cost += 0.5 * cauchy * cauchy * np.log(product)
        for m in range(4):
            gm[j, m] = full[1 + m, 0]
            mm[m] += full[1 + m, 1:5]
            mp[j, m] = full[1 + m, 5:]
        for m in range(3):
            gp[j, m] = full[5 + m, 0]
            pp[j, m] = full[5 + m, 5:]
    return NormalEquations(mm, gm, mp, pp, gp, cost)


@njit(cache=True, nogil=True)
def _expmap(v: NDArray[np.floating]) -> Matrix:
    angle = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    K = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    R: Matrix = np.eye(3) + K
    if angle > 1e-12:
        R = np.eye(3) + np.sin(angle) / angle * K + (1 - np.cos(angle)) / (angle * angle) * (K @ K)
    return R


@njit(cache=True, nogil=True)
def _eliminate(H: NormalEquations, j: int, damping: float, L: Matrix, Z: Matrix) -> None:
    """Cholesky factor L (3, 3) of the damped block of point j; Z (5, 3) receives L^-1 [mp^T, p], column by column."""
    factor_landmark(H.pp[j], damping, L)
    for i in range(4):
        solve_lower(L, H.mp[j, i], Z[i])
    solve_lower(L, H.p[j], Z[4])


@njit(cache=True, nogil=True)
def _motion_step(H: NormalEquations, Z: Blocks, damping: float, free_rate: bool) -> NDArray[np.floating]:
    """Solve the reduced equations of the motion, (4,)."""
    S, b = H.mm.copy(), np.zeros(4)
    for m in range(4):
        S[m, m] += damping * H.mm[m, m] + 1e-12
    for j in range(len(Z)):
        for m in range(4):
            b[m] -= H.m[j, m]
            for k in range(3):
                b[m] += Z[j, m, k] * Z[j, 4, k]
                for n in range(4):
                    S[m, n] -= Z[j, m, k] * Z[j, n, k]
    if not free_rate:
        S[3, :] = 0.0
        S[:, 3] = 0.0
        S[3, 3] = 1.0
        b[3] = 0.0
    return np.linalg.solve(S, b)


@njit(cache=True, nogil=True)
def _step(H: NormalEquations, damping: float, free_rate: bool) -> tuple[NDArray[np.floating], Matrix, float]:
    """Solve the damped normal equations; returns the steps of motion (4,) and points (P, 3), and the expected gain.

    The gain, in px^2, is a lower bound on the decrease of the linearised cost.
    """
    P = len(H.p)
    L, Z = np.empty((P, 3, 3)), np.empty((P, 5, 3))
    for j in range(P):
        _eliminate(H, j, damping, L[j], Z[j])
    dm, dp = _motion_step(H, Z, damping, free_rate), np.empty((P, 3))
    slope = 0.0
    for j in range(P):
        for m in range(2, -1, -1):
            value = -Z[j, 4, m]
            for i in range(4):
                value -= Z[j, i, m] * dm[i]
            for k in range(m + 1, 3):
                value -= L[j, k, m] * dp[j, k]
            dp[j, m] = value / L[j, m, m]
            slope += H.p[j, m] * dp[j, m]
        for i in range(4):
            slope += H.m[j, i] * dm[i]
    return dm, dp, -0.5 * slope


@njit(cache=True, nogil=True)
def _levenberg_marquardt(
    Q: Matrix, rate: float, y: Matrix, rows: ObservationRows, cauchy: float, limits: tuple[bool, int, float]
) -> tuple[Matrix, float, Matrix, float, int]:
    """One pass over the observations gives cost and equations; those of an accepted step are used by the next one."""
    free_rate, iterations, tolerance = limits
    H = normal_equations(Q, rate, y, rows, cauchy, 1)
    damping = 1e-4
    used = 0
    while used < iterations:
        used += 1
        gain = 0.0
        for _ in range(10):
            dm, dp, expected = _step(H, damping, free_rate)
            if expected <= tolerance * H.cost:
                break
            trial_Q, trial_rate, trial_y = Q @ _expmap(dm[:3]), rate + dm[3], y + dp
            trial = normal_equations(trial_Q, trial_rate, trial_y, rows, cauchy, 1)
            if trial.cost < H.cost:
                gain = H.cost - trial.cost
                Q, rate, y, H = trial_Q, trial_rate, trial_y, trial
                damping = max(damping / 5, 1e-12)
                break
            damping *= 8
        if gain <= tolerance * H.cost:
            break
    return Q, rate, y, H.cost, used


def linear_points(motion: Motion, obs: Observations) -> Matrix:
    """Landmarks (P, 3) for a given motion, by linear least squares."""
    return np.asarray(triangulate(motion.Q, motion.rate_hz, obs.rows))


def bundle_adjustment(
    motion: Motion,
    y: Matrix,
    obs: Observations,
    cauchy_px: float,
    free_rate: bool = True,
    iterations: int = 50,
) -> OrbitSolution:
    """Minimise the robust reprojection error over Q, the rate (if free) and all landmarks.

    cauchy_px: scale of Cauchy's function, <= 0 for plain least squares. Stops when a step reduces, or is
    expected to reduce, the cost by less than 1e-10 of it.
    """
    Q, rate, points, cost, used = _levenberg_marquardt(
        np.ascontiguousarray(motion.Q),
        float(motion.rate_hz),
        np.ascontiguousarray(y),
        obs.rows,
        float(cauchy_px),
        (free_rate, iterations, _RELATIVE_GAIN),
    )
    U, _, Vt = np.linalg.svd(Q)  # removes the rounding errors of many small rotations
    return OrbitSolution(Motion(U @ Vt, float(rate)), points, float(cost), int(used))
