"""Axis search: initialisation without COLMAP, by a search over the direction of the axis.

For a given axis and rate each landmark is a linear least-squares solution. A coarse set of axes over the sphere is
tried, each refined by bundle adjustment at a fixed rate. Mirrored and wrong axes appear as further local minima.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution, bundle_adjustment, linear_points
from esfo_backend.errors import BackendError
from esfo_backend.options import InitialisationOptions
from esfo_backend.orbit.observations import Observations
from esfo_backend.orbit.parametrization import motion_from_axis
from esfo_backend.orbit.selection import longest_points
from esfo_core.orbit import Matrix, Vector, angle_between, rotation, tangent_basis

_COARSE_ITERATIONS = 8
_FINE_ITERATIONS = 15
_FINAL_ITERATIONS = 20
_SAME_OPTIMUM_DEG = 2.0
_NEAR_VIEW_DEG, _RINGS_DEG, _AROUND = 20.0, (3.0, 8.0), 6
"""Parallax depends on the angle between axis and line of sight; small angles need a denser set of axes."""


@dataclass(frozen=True)
class AxisSearchResult:
    """best: the optimum of lowest cost. second: the next distinct one, None when all axes lead to the same."""

    best: OrbitSolution
    second: OrbitSolution | None


def directions(count: int) -> Matrix:
    """Return `count` unit vectors (count, 3), even over the sphere (Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    longitude = np.pi * (1 + 5**0.5) * k
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(longitude), radius * np.sin(longitude), z], axis=1)


def mean_direction(obs: Observations) -> Vector:
    """Direction (3,) towards the median of all observations, not normalised."""
    return np.append(np.median(obs.rows.xy, axis=0), 1.0)


def search_axis(obs: Observations, rate_hz: float, options: InitialisationOptions) -> AxisSearchResult:
    """Search the axis at the fixed rate `rate_hz`; the optima are refined with all observations.

    Axes are tried on all processors; the result does not depend on their number. Raises BackendError when no axis has
    a finite cost.
    """
    towards, sample = mean_direction(obs), longest_points(obs, options.search_tracks)
    axes = [a for a in directions(options.axes) if min(angle_between(a, towards), angle_between(-a, towards)) >= 1]

    def tried(axis: Vector) -> OrbitSolution:
        motion = motion_from_axis(axis, towards, rate_hz)
        return bundle_adjustment(
            motion, linear_points(motion, sample), sample, options.cauchy_px, False, _COARSE_ITERATIONS
        )

    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        coarse = _by_cost(pool.map(tried, axes))
        if coarse and (view := _near_view(coarse[0].motion.axis, towards)) is not None:
            coarse = _by_cost([*coarse, *pool.map(tried, _rings(view))])
    if not coarse:
        raise BackendError(f"no axis explains {obs.points} tracks at {rate_hz:.4f} Hz")
    optima = _distinct(coarse, sample, options, _FINE_ITERATIONS, 3)
    final = _distinct(optima, obs, options, _FINAL_ITERATIONS, 2)
    return AxisSearchResult(final[0], final[1] if len(final) > 1 else None)


def _by_cost(tried: Iterable[OrbitSolution]) -> list[OrbitSolution]:
    return sorted((c for c in tried if np.isfinite(c.cost)), key=lambda c: c.cost)


def _near_view(axis: Vector, towards: Vector) -> Vector | None:
    """The line of sight, in the direction that an axis is close to; None if it is close to neither."""
    return next((view for view in (towards, -towards) if angle_between(axis, view) < _NEAR_VIEW_DEG), None)


def _rings(view: Vector) -> list[Vector]:
    """Axes on cones about the line of sight."""
    middle = view / np.linalg.norm(view)
    aside = tangent_basis(middle)[:, 0]
    tilted = [rotation(aside, np.radians(deg)) @ middle for deg in _RINGS_DEG]
    return [rotation(middle, 2 * np.pi * k / _AROUND) @ axis for axis in tilted for k in range(_AROUND)]


def _distinct(
    candidates: list[OrbitSolution], obs: Observations, options: InitialisationOptions, iterations: int, count: int
) -> list[OrbitSolution]:
    """Refine candidates in their order until there are `count` distinct optima; the lowest cost first."""
    optima: list[OrbitSolution] = []
    for candidate in candidates:
        if any(_same(candidate, o) for o in optima):
            continue
        y = linear_points(candidate.motion, obs)
        refined = bundle_adjustment(candidate.motion, y, obs, options.cauchy_px, False, iterations)
        if not any(_same(refined, o) for o in optima):
            optima.append(refined)
        if len(optima) == count:
            break
    return sorted(optima, key=lambda c: c.cost)


def _same(a: OrbitSolution, b: OrbitSolution) -> bool:
    return angle_between(a.motion.axis, b.motion.axis) < _SAME_OPTIMUM_DEG
