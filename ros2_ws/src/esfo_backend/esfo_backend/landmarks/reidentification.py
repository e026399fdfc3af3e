"""Re-identification: merges tracks that observe the same landmark in different revolutions.

A track lasts a fraction of a revolution, in which rate and depth are correlated. Two tracks are merged when they do not
overlap in time, their landmarks agree within their covariance in the object frame, and one landmark explains both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution, bundle_adjustment, linear_points, normal_equations
from esfo_backend.adjustment.elimination import REGULARISATION
from esfo_backend.options import ReidentificationOptions
from esfo_backend.orbit.observations import Observations
from esfo_backend.orbit.parametrization import Motion
from esfo_backend.orbit.projection import row_errors
from esfo_core.orbit import Vector

Labels = NDArray[np.int64]

_MEDIAN_OF_CHI2_2 = 1.386
ROUND_ITERATIONS = 12
"""Iterations of a bundle adjustment between two rounds, enough for a fraction of the standard deviations."""


def noise_px(errors: Vector) -> float:
    """Standard deviation of one coordinate, from the median of 2-D errors (N,), robust to outliers."""
    return float(np.sqrt(np.median(errors**2) / _MEDIAN_OF_CHI2_2))


def point_rms(errors: Vector, obs: Observations) -> Vector:
    """RMS reprojection error of each landmark, (P,) px."""
    return np.asarray(np.sqrt(np.add.reduceat(errors**2, obs.rows.first[:-1]) / np.diff(obs.rows.first)))


def merge_round(
    solution: OrbitSolution, obs: Observations, label: Labels, options: ReidentificationOptions, cauchy_px: float
) -> Labels:
    """Merge landmarks pairwise, each at most once; return the new label of each track, (M,), consecutive from 0.

    obs: one landmark per track, (M tracks). label: (M,) current landmark of each track; solution: of
    `obs.regroup(label)`. A merged landmark is split again when the error of one of its tracks exceeds `rms_px`.
    """
    grouped = obs.regroup(label)
    pairs = _candidate_pairs(solution, grouped, options, cauchy_px)
    pairs = _without_overlap(pairs, obs, label)
    if not len(pairs):
        return label
    partner = np.arange(grouped.points)
    used = np.zeros(grouped.points, bool)
    for a, b in pairs:
        if not used[a] and not used[b]:
            used[a] = used[b] = True
            partner[b] = a
    merged = _consecutive(partner[label])
    bad = _misfit(solution.motion, obs, merged, options.rms_px)
    split = np.isin(merged, np.flatnonzero(bad))
    # Split landmarks get their former labels back, offset above the labels of the merged ones.
    return _consecutive(np.where(split, merged.max() + 1 + label, merged))


def _consecutive(label: Labels) -> Labels:
    return np.asarray(np.unique(label, return_inverse=True)[1].astype(np.int64))


def _candidate_pairs(
    solution: OrbitSolution, grouped: Observations, options: ReidentificationOptions, cauchy_px: float
) -> NDArray[np.int64]:
    """Pairs (K, 2) of landmarks that agree within their covariance, nearest first."""
    y = solution.y
    errors = np.asarray(row_errors(solution.motion.Q, solution.motion.rate_hz, y, grouped.rows))
    consistent = (point_rms(errors, grouped) < options.rms_px) & np.isfinite(y).all(axis=1)
    index = np.flatnonzero(consistent)
    if len(index) < 2:
        return np.empty((0, 2), np.int64)
    H = normal_equations(solution.motion.Q, solution.motion.rate_hz, y, grouped.rows, cauchy_px, 1).pp[index]
    covariance = max(noise_px(errors[np.isfinite(errors)]), 0.05) ** 2 * np.linalg.inv(H + REGULARISATION * np.eye(3))
    k = min(options.neighbours + 1, len(index))
    _, near = cKDTree(y[index]).query(y[index], k)
    a, b = np.repeat(np.arange(len(index)), k), near.ravel()
    ordered = a < b
    a, b = a[ordered], b[ordered]
    gap = y[index][a] - y[index][b]
    d2 = np.einsum("ki,ki->k", gap, np.linalg.solve(covariance[a] + covariance[b], gap[:, :, None])[:, :, 0])
    close = d2 < options.chi2
    order = np.lexsort((b[close], a[close], d2[close]))
    return np.asarray(np.stack([index[a[close]], index[b[close]]], axis=1)[order])


def _without_overlap(pairs: NDArray[np.int64], obs: Observations, label: Labels) -> NDArray[np.int64]:
    """Drop pairs of landmarks that were observed at the same time: they are distinct."""
    begin, end = obs.rows.dt[obs.rows.first[:-1]], obs.rows.dt[obs.rows.first[1:] - 1]
    members = [np.flatnonzero(label == j) for j in range(int(label.max(initial=-1)) + 1)]
    keep = [
        not (
            (begin[members[a], None] <= end[None, members[b]]) & (begin[None, members[b]] <= end[members[a], None])
        ).any()
        for a, b in pairs
    ]
    return np.asarray(pairs[np.array(keep, bool)])


def _misfit(motion: Motion, obs: Observations, merged: Labels, limit_px: float) -> NDArray[np.bool_]:
    """Which merged landmarks (P,) have a track with an RMS error above `limit_px`."""
    grouped = obs.regroup(merged)
    y = linear_points(motion, grouped)
    errors = np.asarray(row_errors(motion.Q, motion.rate_hz, y[merged], obs.rows))
    members = np.bincount(merged, minlength=grouped.points)
    bad = np.zeros(grouped.points, bool)
    bad[merged[point_rms(errors, obs) > limit_px]] = True
    return bad & (members > 1)


def reidentify(
    solution: OrbitSolution,
    obs: Observations,
    label: Labels,
    options: ReidentificationOptions,
    cauchy_px: float,
    free_rate: bool,
) -> tuple[OrbitSolution, Labels]:
    """Merge and refit until no pair is merged, at most `options.rounds` times."""
    for _ in range(options.rounds):
        merged = merge_round(solution, obs, label, options, cauchy_px)
        if merged.max() == label.max():
            break
        label = merged
        grouped = obs.regroup(label)
        y = linear_points(solution.motion, grouped)
        solution = bundle_adjustment(solution.motion, y, grouped, cauchy_px, free_rate, ROUND_ITERATIONS)
    return solution, label
