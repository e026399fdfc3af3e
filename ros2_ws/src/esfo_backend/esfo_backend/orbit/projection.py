"""Kernels of the orbit model: residuals, Jacobians, robust cost. All solvers use them."""

from __future__ import annotations

import numpy as np
from numba import njit

from esfo_backend.orbit.observations import ObservationRows
from esfo_core.orbit import Matrix, Vector

BEHIND_CAMERA_COST = 1e4
"""Robust cost in px^2 of an observation whose landmark lies behind the camera: larger than any visible error."""

_NEAREST = 1e-3


@njit(cache=True, nogil=True)
def project_row(Q: Matrix, rate: float, y: Vector, dt: float, X: Vector) -> None:
    """Write the camera coordinates of object point y (3,) at time dt into X (3,): X = Q (Rz(-theta) y - e_x)."""
    theta = 2 * np.pi * rate * dt
    c, s = np.cos(theta), np.sin(theta)
    w0, w1, w2 = c * y[0] + s * y[1] - 1.0, c * y[1] - s * y[0], y[2]
    for i in range(3):
        X[i] = Q[i, 0] * w0 + Q[i, 1] * w1 + Q[i, 2] * w2


@njit(cache=True, nogil=True)
def linearize_row(Q: Matrix, rate: float, y: Vector, rows: ObservationRows, k: int, out: Matrix) -> bool:
    """Residual and Jacobians of row k of point y (3,), weighted, in px; false when the point is behind the camera.

    out: (2, 8) receives the residual (column 0), its derivative by a right rotation vector of Q (1:4), by the rate (4)
    and by y (5:8).
    """
    theta = 2 * np.pi * rate * rows.dt[k]
    c, s = np.cos(theta), np.sin(theta)
    w0, w1, w2 = c * y[0] + s * y[1] - 1.0, c * y[1] - s * y[0], y[2]
    z = Q[2, 0] * w0 + Q[2, 1] * w1 + Q[2, 2] * w2
    if z < _NEAREST:
        return False
    dtheta = 2 * np.pi * rows.dt[k]  # d theta / d rate
    d0, d1 = dtheta * w1, -dtheta * (w0 + 1.0)
    for i in range(2):
        gain = rows.focal[i] * rows.weight[k]
        x = (Q[i, 0] * w0 + Q[i, 1] * w1 + Q[i, 2] * w2) / z
        # g is the gradient of residual i by w = Rz(-theta) y - e_x.
        g0 = gain / z * (Q[i, 0] - x * Q[2, 0])
        g1 = gain / z * (Q[i, 1] - x * Q[2, 1])
        g2 = gain / z * (Q[i, 2] - x * Q[2, 2])
        out[i, 0] = gain * (x - rows.xy[k, i])
        out[i, 1] = g2 * w1 - g1 * w2
        out[i, 2] = g0 * w2 - g2 * w0
        out[i, 3] = g1 * w0 - g0 * w1
        out[i, 4] = g0 * d0 + g1 * d1
        out[i, 5] = g0 * c - g1 * s
        out[i, 6] = g0 * s + g1 * c
        out[i, 7] = g2
    return True


@njit(cache=True, nogil=True)
def cauchy_weight(residual: Matrix, cauchy: float) -> float:
    """Weight 1 / (1 + |r|^2 / c^2) of a row with `residual` in column 0 of a (2, 8) block; 1 for c <= 0."""
    if cauchy <= 0:
        return 1.0
    squared: float = residual[0, 0] * residual[0, 0] + residual[1, 0] * residual[1, 0]
    return 1.0 / (1.0 + squared / (cauchy * cauchy))


@njit(cache=True, nogil=True)
def linearize_stack(Q: Matrix, rate: float, y: Vector, rows: ObservationRows, cauchy: float, power: int) -> Matrix:
    """All rows of one point y (3,) as (2N, 8) blocks of `linearize_row`, times the root of the Cauchy weight^power.

    power 1 is the weight of the iteration (IRLS); power 2 makes J^T J the mean second derivative of the loss. Rows
    behind the camera are zero.
    """
    stack = np.zeros((2 * len(rows.dt), 8))
    for k in range(len(rows.dt)):
        block = stack[2 * k : 2 * k + 2]
        if linearize_row(Q, rate, y, rows, k, block):
            block *= np.sqrt(cauchy_weight(block, cauchy) ** power)
    return stack


@njit(cache=True, nogil=True)
def row_errors(Q: Matrix, rate: float, y: Matrix, rows: ObservationRows) -> Vector:
    """Unweighted reprojection error of each row in px, (N,); infinite behind the camera."""
    X = np.empty(3)
    out = np.empty(len(rows.dt))
    for j in range(len(rows.first) - 1):
        for k in range(rows.first[j], rows.first[j + 1]):
            project_row(Q, rate, y[j], rows.dt[k], X)
            if X[2] < _NEAREST:
                out[k] = np.inf
                continue
            a = rows.focal[0] * (X[0] / X[2] - rows.xy[k, 0])
            b = rows.focal[1] * (X[1] / X[2] - rows.xy[k, 1])
            out[k] = np.hypot(a, b)
    return out


@njit(cache=True, nogil=True)
def robust_cost(Q: Matrix, rate: float, y: Matrix, rows: ObservationRows, cauchy: float) -> float:
    """Sum over rows of Cauchy's (c^2 / 2) log(1 + r^2 / c^2), px^2; c <= 0 means half the squared residual."""
    total = 0.0
    errors = row_errors(Q, rate, y, rows)
    for k in range(len(errors)):
        if np.isinf(errors[k]):
            total += BEHIND_CAMERA_COST
            continue
        q = (errors[k] * rows.weight[k]) ** 2
        total += 0.5 * cauchy * cauchy * np.log1p(q / (cauchy * cauchy)) if cauchy > 0 else 0.5 * q
    return total


@njit(cache=True, nogil=True)
def triangulate(Q: Matrix, rate: float, rows: ObservationRows) -> Matrix:
    """Initial landmarks (P, 3): the least-squares solution of (M0 - x M2) y = e0 - x e2 and the same for the image's y.

    M = Q Rz(-theta), e = Q e_x. All observations have equal weight, since the depths are similar. A solution
    behind the camera is replaced by the point on the ray of the middle row that is nearest to the axis.
    """
    P = len(rows.first) - 1
    out = np.empty((P, 3))
    X, a = np.empty(3), np.empty(3)
    for j in range(P):
        A, b = np.zeros((3, 3)), np.zeros(3)
        for k in range(rows.first[j], rows.first[j + 1]):
            theta = 2 * np.pi * rate * rows.dt[k]
            c, s = np.cos(theta), np.sin(theta)
            for i in range(2):
                x = rows.xy[k, i]
                g0, g1 = Q[i, 0] - x * Q[2, 0], Q[i, 1] - x * Q[2, 1]
                a[0], a[1], a[2] = g0 * c - g1 * s, g0 * s + g1 * c, Q[i, 2] - x * Q[2, 2]
                for m in range(3):
                    b[m] += a[m] * g0
                    for n in range(3):
                        A[m, n] += a[m] * a[n]
        for m in range(3):
            A[m, m] += 1e-9 * A[m, m] + 1e-12
        out[j] = np.linalg.solve(A, b)
        ahead = True
        for k in range(rows.first[j], rows.first[j + 1]):
            project_row(Q, rate, out[j], rows.dt[k], X)
            ahead = ahead and X[2] >= 10 * _NEAREST
        if not ahead:
            _place_on_ray(Q, rate, rows, (rows.first[j] + rows.first[j + 1]) // 2, out[j])
    return out


@njit(cache=True, nogil=True)
def _place_on_ray(Q: Matrix, rate: float, rows: ObservationRows, k: int, y: Vector) -> None:
    """Write into y (3,) the point on the ray of row k that is nearest to the axis."""
    theta = 2 * np.pi * rate * rows.dt[k]
    c, s = np.cos(theta), np.sin(theta)
    ray = np.empty(3)
    for m in range(3):
        ray[m] = Q[0, m] * rows.xy[k, 0] + Q[1, m] * rows.xy[k, 1] + Q[2, m]
    # In the axes of Q, with the camera at the origin, the axis is the line (-1, 0, *).
    across = ray[0] * ray[0] + ray[1] * ray[1]
    depth = max(-ray[0] / max(across, 1e-9), 0.05)
    w0, w1, w2 = depth * ray[0] + 1.0, depth * ray[1], depth * ray[2]
    y[0], y[1], y[2] = c * w0 - s * w1, s * w0 + c * w1, w2
