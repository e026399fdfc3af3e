"""Whether one rotation explains the whole recording: whether the axis stays, and the object comes back to its place.

The motion is estimated anew in short segments of the recording and compared, with the statistics of a meta-analysis:
Cochran's Q (Biometrics 1954) says whether segments differ by more than their deviations, the estimate of DerSimonian
and Laird (Controlled Clinical Trials 1986) by how much. A body that moves on, or turns about another axis as well, is
seen elsewhere, or larger, one turn later: that is looked at in the image, whatever the points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from gtsam import Rot3
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution, bundle_adjustment, linear_points
from esfo_backend.adjustment.consider_bias import COLUMNS, MOTION, gauss_newton
from esfo_backend.adjustment.covariance import MotionCovariance
from esfo_backend.orbit.observations import Observations
from esfo_core.orbit import Matrix, Vector

_PER_TURN = 3
_MOST, _LEAST = 12, 3
_LEAST_POINTS = 12
_LEAST_ROWS = 4
_MOST_POINTS = 150
_ITERATIONS = 8
_PAIR_PX = 6.0
_TIMES_PER_TURN = 72
_LONGEST_GAP = 7
"""Times, a tenth of a turn: two rows further apart are of different appearances of a point."""
_LEAST_PAIRS = 50


@dataclass(frozen=True)
class Rigidity:
    """How far the motion departs from one rotation about one fixed axis.

    axis_wander_deg: standard deviation of the orientation of the orbit over segments, beyond what their own deviations
    explain. axis_wander_z: its significance. closure_error_px: by how much the image one revolution later is shifted or
    grown. closure_error_z: its significance. closure_error_revolutions: the part of a revolution that would move a
    point at the object's image radius as far. Significances are in standard deviations; 0 where the data cannot say.
    """

    axis_wander_deg: float
    axis_wander_z: float
    closure_error_px: float
    closure_error_z: float
    closure_error_revolutions: float


def widened(
    covariance: MotionCovariance, motion: Rigidity, rate_hz: float, turns_rad: float, least_z: float
) -> MotionCovariance:
    """Add what a motion that is not quite one rotation leaves open, by what is significant to least_z.

    A shift of the image from turn to turn may be taken for an error of the rate; and while the object moves on, it is
    seen from elsewhere, as if its axis turned. turns_rad: by how many radians to either side of the mean over the
    recording for each pixel that it shifts in a turn, that is half the turns over the focal length.
    """
    axis_wander_deg = motion.axis_wander_deg if motion.axis_wander_z > least_z else 0.0
    closure_error_px, closure_error_revolutions = (
        (motion.closure_error_px, motion.closure_error_revolutions) if motion.closure_error_z > least_z else (0.0, 0.0)
    )
    rate_std = float(np.hypot(covariance.rate_std_hz, rate_hz * closure_error_revolutions))
    turned = np.radians(axis_wander_deg) ** 2 + (turns_rad * closure_error_px) ** 2
    return MotionCovariance(rate_std, covariance.axis_cov + turned * np.eye(2))


def rigidity(solution: OrbitSolution, obs: Observations, cauchy_px: float, bias_px: float) -> Rigidity:
    """Measure how constant the motion is."""
    return Rigidity(*_axis_wander(solution, obs, cauchy_px, bias_px), *_closure_error(obs, solution.motion.rate_hz))


def _closure_error(obs: Observations, rate_hz: float) -> tuple[float, float, float]:
    """Return closure_error_px, closure_error_z, closure_error_revolutions.

    Each point is set beside the one that is seen nearest to it one revolution later.

    The displacements are fitted (Cauchy, 1 px) by a shift, a growth and a delay along the motion; the delay is an error
    of the rate, and not counted.
    """
    px, velocity, time, point = _at_common_times(obs, rate_hz)
    apart = 10 * _PAIR_PX * time  # of another time is out of reach
    if len(time) < _LEAST_PAIRS:
        return 0.0, 0.0, 0.0
    later = np.column_stack([px, apart + 10 * _PAIR_PX * _TIMES_PER_TURN])
    distance, found = cKDTree(np.column_stack([px, apart])).query(later, distance_upper_bound=_PAIR_PX)
    k = np.flatnonzero(np.isfinite(distance))
    if len(k) < _LEAST_PAIRS:
        return 0.0, 0.0, 0.0
    moved = px[found[k]] - px[k]
    place = px[k] - np.median(px[k], axis=0)
    design = np.zeros((len(k), 2, 4))
    design[:, 0, 0] = design[:, 1, 1] = 1.0
    radius = max(float(np.sqrt((place**2).sum(axis=1).mean())), 1e-9)
    design[:, :, 2] = place / radius
    design[:, :, 3] = velocity[k] / max(float(np.median(np.linalg.norm(velocity[k], axis=1))), 1e-9)
    fitted, covariance = _robust_fit(design, moved, point[k])
    missed = fitted[:3]
    squared = float(missed @ np.linalg.pinv(covariance[:3, :3], hermitian=True) @ missed)
    closure_error_px = float(np.linalg.norm(missed))
    return closure_error_px, _significance(squared, 3), closure_error_px / (2 * np.pi * radius)


def _at_common_times(obs: Observations, rate_hz: float) -> tuple[Matrix, Matrix, NDArray[np.int64], NDArray[np.int64]]:
    """Interpolate tracks at times that are the same in every turn.

    Returns places (K, 2) px, velocities (K, 2) px/s, numbers of the times (K,) and points (K,).
    """
    dt, point = obs.rows.dt, obs.point_index()
    px = obs.rows.xy * obs.rows.focal
    step = 1 / (rate_hz * _TIMES_PER_TURN)
    near = (np.diff(point) == 0) & (np.diff(dt) > 0) & (np.diff(dt) < _LONGEST_GAP * step)
    k = np.flatnonzero(near)
    first = np.ceil(dt[k] / step).astype(np.int64)
    count = np.ceil(dt[k + 1] / step).astype(np.int64) - first
    time = np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())
    k = np.repeat(k, count)
    velocity = (px[k + 1] - px[k]) / (dt[k + 1] - dt[k])[:, None]
    return px[k] + velocity * (time * step - dt[k])[:, None], velocity, time, point[k]


def _robust_fit(
    design: NDArray[np.float64], values: Matrix, cluster: NDArray[np.int64]
) -> tuple[Vector, NDArray[np.float64]]:
    """Least squares of (N, 2) values by (N, 2, K) columns with Cauchy weights of 1 px, and its covariance (K, K).

    Only rows of different clusters (N,) are independent (sandwich estimator).
    """
    fitted = np.zeros(design.shape[2])
    for _ in range(_ITERATIONS):
        residual = values - design @ fitted
        w = 1 / (1 + (residual**2).sum(axis=1))
        inverse = np.linalg.pinv(np.einsum("nka,n,nkb->ab", design, w, design), hermitian=True)
        fitted = fitted + inverse @ np.einsum("nka,n,nk->a", design, w, residual)
    score = np.zeros((int(cluster.max()) + 1, design.shape[2]))
    np.add.at(score, cluster, np.einsum("nka,n,nk->na", design, w, residual))
    return fitted, inverse @ (score.T @ score) @ inverse


def _significance(chi2: float, freedom: int) -> float:
    """Deviations of a normal variable as unlikely as chi2 (Wilson and Hilferty, PNAS 1931); 0 below the mean."""
    shrink = 2 / (9 * freedom)
    return max(float((np.cbrt(chi2 / freedom) - (1 - shrink)) / np.sqrt(shrink)), 0.0)


def _axis_wander(solution: OrbitSolution, obs: Observations, cauchy_px: float, bias_px: float) -> tuple[float, float]:
    span = float(np.ptp(obs.rows.dt))
    count = int(np.clip(_PER_TURN * solution.motion.rate_hz * span, _LEAST, _MOST))
    segment = np.minimum(((obs.rows.dt - obs.rows.dt.min()) / span * count).astype(np.int64), count - 1)
    found = [_segment(solution, obs.part(segment == k, _LEAST_ROWS), cauchy_px, bias_px) for k in range(count)]
    estimates = [f for f in found if f is not None]
    if len(estimates) < _LEAST:
        return 0.0, 0.0
    turned = np.array([e[0] for e in estimates])
    weight = np.linalg.inv([e[1] for e in estimates])
    total = weight.sum(axis=0)
    off = turned - np.linalg.solve(total, np.einsum("kij,kj->i", weight, turned))
    Q = float(np.einsum("ki,kij,kj->", off, weight, off))
    freedom = 3 * (len(estimates) - 1)
    excess = Q - freedom
    spread = np.trace(total) - np.trace(np.linalg.solve(total, np.einsum("kij,kjl->il", weight, weight)))
    return float(np.degrees(np.sqrt(max(excess, 0.0) / spread))), _significance(Q, freedom)


def _segment(
    solution: OrbitSolution, obs: Observations, cauchy_px: float, bias_px: float
) -> tuple[Vector, Matrix] | None:
    """Rotation vector (3,) from the motion of the whole to that of the segment, and its covariance; None: too few."""
    if obs.points < _LEAST_POINTS:
        return None
    if obs.points > _MOST_POINTS:
        rows = np.diff(obs.rows.first)
        most = np.sort(np.argsort(-rows, kind="stable")[:_MOST_POINTS])
        label = np.full(obs.points, -1, np.int64)
        label[most] = np.arange(_MOST_POINTS)
        obs = obs.regroup(label)
    motion = solution.motion
    own = bundle_adjustment(motion, linear_points(motion, obs), obs, cauchy_px, iterations=_ITERATIONS)
    _, covariance = gauss_newton(own, obs, cauchy_px, np.arange(COLUMNS)[MOTION], bias_px)
    if not np.isfinite(covariance).all():
        return None
    return np.asarray(Rot3.Logmap(Rot3(motion.Q.T @ own.motion.Q))), covariance[:3, :3] + 1e-12 * np.eye(3)
