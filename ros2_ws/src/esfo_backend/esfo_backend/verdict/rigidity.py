"""Test whether one rotation about a fixed axis explains the whole recording.

The motion is estimated in short segments of the recording and compared with the statistics of a meta-analysis:
Cochran's Q (Biometrics 1954) tests whether segments differ by more than their standard deviations, the estimate of
DerSimonian and Laird (Controlled Clinical Trials 1986) gives by how much. A body that translates, or rotates about a
second axis as well, appears shifted or scaled one revolution later: this is measured in the image, without landmarks.
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
from esfo_core.estimate import RateEstimate
from esfo_core.orbit import Matrix, Vector

_SEGMENTS_PER_REVOLUTION = 3
_MAX_SEGMENTS, _MIN_SEGMENTS = 12, 3
_MIN_LANDMARKS = 12
_MIN_OBSERVATIONS = 4
_MAX_LANDMARKS = 150
_ITERATIONS = 8
_PAIR_PX = 6.0
_TIMES_PER_REVOLUTION = 72
_MAX_GAP = 7
"""In steps of time, a tenth of a revolution: no interpolation between observations that are further apart."""
_MIN_PAIRS = 50


@dataclass(frozen=True)
class Rigidity:
    """How far the motion departs from one rotation about one fixed axis.

    axis_wander_deg: standard deviation of the orientation of the orbit over segments, beyond their own standard
    deviations. axis_wander_z: its significance. closure_error_px: how far the image one revolution later is shifted or
    scaled. closure_error_z: its significance. closure_error_revolutions: fraction of a revolution that moves a point
    at the object's image radius as far. Significances are in standard deviations; 0 where the data are too few.
    delay_s, delay_std_s: by how much later than after one revolution of the orbit's rate tracks are at the same place
    again, and its standard deviation, infinite where the data are too few.
    """

    axis_wander_deg: float
    axis_wander_z: float
    closure_error_px: float
    closure_error_z: float
    closure_error_revolutions: float
    delay_s: float = 0.0
    delay_std_s: float = np.inf

    def track_rate(self, rate_hz: float) -> RateEstimate | None:
        """Spin rate of the tracks that are observed again, by their delay; None where they are too few.

        rate_hz: of the orbit.
        """
        if not np.isfinite(self.delay_std_s):
            return None
        rate = 1 / (1 / rate_hz + self.delay_s)
        return RateEstimate(rate, rate**2 * self.delay_std_s)


def widened(
    covariance: MotionCovariance, motion: Rigidity, rate_hz: float, rad_per_px: float, least_z: float
) -> MotionCovariance:
    """Add the departures from one rotation whose significance exceeds least_z to the covariance.

    A shift of the image from revolution to revolution may be an error of the rate. A translation of the object changes
    the direction of view, which has the effect of a rotation of the axis. rad_per_px: largest such rotation from its
    mean over the recording, per pixel of shift in a revolution: half the revolutions over the focal length.
    """
    axis_wander_deg = motion.axis_wander_deg if motion.axis_wander_z > least_z else 0.0
    closure_error_px, closure_error_revolutions = (
        (motion.closure_error_px, motion.closure_error_revolutions) if motion.closure_error_z > least_z else (0.0, 0.0)
    )
    rate_std = float(np.hypot(covariance.rate_std_hz, rate_hz * closure_error_revolutions))
    variance = np.radians(axis_wander_deg) ** 2 + (rad_per_px * closure_error_px) ** 2
    return MotionCovariance(rate_std, covariance.axis_cov + variance * np.eye(2))


def rigidity(solution: OrbitSolution, obs: Observations, cauchy_px: float, bias_px: float) -> Rigidity:
    """Measure how far the motion departs from one rotation about one fixed axis."""
    return Rigidity(*_axis_wander(solution, obs, cauchy_px, bias_px), *_closure_error(obs, solution.motion.rate_hz))


def _closure_error(obs: Observations, rate_hz: float) -> tuple[float, float, float, float, float]:
    """Return closure_error_px, closure_error_z, closure_error_revolutions, delay_s, delay_std_s.

    Each track position is paired with the nearest one of one revolution later. The displacements are fitted (Cauchy,
    1 px) by a shift, a change of scale and a delay along the motion; the delay is an error of the rate and no part of
    the closure error.
    """
    px, velocity, time, point = _at_common_times(obs, rate_hz)
    apart = 10 * _PAIR_PX * time  # separates the times by more than the search radius
    if len(time) < _MIN_PAIRS:
        return 0.0, 0.0, 0.0, 0.0, np.inf
    later = np.column_stack([px, apart + 10 * _PAIR_PX * _TIMES_PER_REVOLUTION])
    distance, found = cKDTree(np.column_stack([px, apart])).query(later, distance_upper_bound=_PAIR_PX)
    k = np.flatnonzero(np.isfinite(distance))
    if len(k) < _MIN_PAIRS:
        return 0.0, 0.0, 0.0, 0.0, np.inf
    moved = px[found[k]] - px[k]
    place = px[k] - np.median(px[k], axis=0)
    design = np.zeros((len(k), 2, 4))
    design[:, 0, 0] = design[:, 1, 1] = 1.0
    radius = max(float(np.sqrt((place**2).sum(axis=1).mean())), 1e-9)
    design[:, :, 2] = place / radius
    speed = max(float(np.median(np.linalg.norm(velocity[k], axis=1))), 1e-9)
    design[:, :, 3] = velocity[k] / speed
    fitted, covariance = _robust_fit(design, moved, point[k])
    image_change = fitted[:3]
    squared = float(image_change @ np.linalg.pinv(covariance[:3, :3], hermitian=True) @ image_change)
    closure_error_px = float(np.linalg.norm(image_change))
    # What is late is behind its place.
    delay_s, delay_std_s = -float(fitted[3]) / speed, float(np.sqrt(covariance[3, 3])) / speed
    revolutions = closure_error_px / (2 * np.pi * radius)
    return closure_error_px, _significance(squared, 3), revolutions, delay_s, delay_std_s


def _at_common_times(obs: Observations, rate_hz: float) -> tuple[Matrix, Matrix, NDArray[np.int64], NDArray[np.int64]]:
    """Interpolate tracks at times that have the same phase in every revolution.

    Returns places (K, 2) px, velocities (K, 2) px/s, indices of the times (K,) and tracks (K,).
    """
    dt, point = obs.rows.dt, obs.point_index()
    px = obs.rows.xy * obs.rows.focal
    step = 1 / (rate_hz * _TIMES_PER_REVOLUTION)
    near = (np.diff(point) == 0) & (np.diff(dt) > 0) & (np.diff(dt) < _MAX_GAP * step)
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

    Only values of different clusters (N,) are independent (sandwich estimator).
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
    """Standard score as unlikely as chi2 (Wilson and Hilferty, PNAS 1931); 0 below the mean."""
    shrink = 2 / (9 * freedom)
    return max(float((np.cbrt(chi2 / freedom) - (1 - shrink)) / np.sqrt(shrink)), 0.0)


def _axis_wander(solution: OrbitSolution, obs: Observations, cauchy_px: float, bias_px: float) -> tuple[float, float]:
    span = float(np.ptp(obs.rows.dt))
    count = int(np.clip(_SEGMENTS_PER_REVOLUTION * solution.motion.rate_hz * span, _MIN_SEGMENTS, _MAX_SEGMENTS))
    segment = np.minimum(((obs.rows.dt - obs.rows.dt.min()) / span * count).astype(np.int64), count - 1)
    found = [_segment(solution, obs.part(segment == k, _MIN_OBSERVATIONS), cauchy_px, bias_px) for k in range(count)]
    estimates = [f for f in found if f is not None]
    if len(estimates) < _MIN_SEGMENTS:
        return 0.0, 0.0
    rotations = np.array([e[0] for e in estimates])
    weight = np.linalg.inv([e[1] for e in estimates])
    total = weight.sum(axis=0)
    off = rotations - np.linalg.solve(total, np.einsum("kij,kj->i", weight, rotations))
    Q = float(np.einsum("ki,kij,kj->", off, weight, off))
    freedom = 3 * (len(estimates) - 1)
    excess = Q - freedom
    spread = np.trace(total) - np.trace(np.linalg.solve(total, np.einsum("kij,kjl->il", weight, weight)))
    return float(np.degrees(np.sqrt(max(excess, 0.0) / spread))), _significance(Q, freedom)


def _segment(
    solution: OrbitSolution, obs: Observations, cauchy_px: float, bias_px: float
) -> tuple[Vector, Matrix] | None:
    """Rotation vector (3,) from the whole motion to the segment's, and its covariance; None: too few landmarks."""
    if obs.points < _MIN_LANDMARKS:
        return None
    if obs.points > _MAX_LANDMARKS:
        rows = np.diff(obs.rows.first)
        most = np.sort(np.argsort(-rows, kind="stable")[:_MAX_LANDMARKS])
        label = np.full(obs.points, -1, np.int64)
        label[most] = np.arange(_MAX_LANDMARKS)
        obs = obs.regroup(label)
    motion = solution.motion
    own = bundle_adjustment(motion, linear_points(motion, obs), obs, cauchy_px, iterations=_ITERATIONS)
    covariance = gauss_newton(own, obs, cauchy_px, np.arange(COLUMNS)[MOTION], bias_px).covariance
    if not np.isfinite(covariance).all():
        return None
    return np.asarray(Rot3.Logmap(Rot3(motion.Q.T @ own.motion.Q))), covariance[:3, :3] + 1e-12 * np.eye(3)
