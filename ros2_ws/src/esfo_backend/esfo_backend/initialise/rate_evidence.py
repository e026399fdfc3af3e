"""Whether the tracks fit a rate, and an axis, better than others, by Vuong's test of non-nested models.

The event stream cannot tell the period of a symmetric object from its multiples, and sampling may alias it. The tracks
can: at another rate the same image motion needs another geometry. For each track the robust cost at two rates is
compared, each with its own best axis and with one landmark per track, so that nothing is assumed of what is observed
again. The mean difference over its standard error is normally distributed where both rates fit equally well (Vuong,
Econometrica 1989).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution, bundle_adjustment, linear_points
from esfo_backend.errors import BackendError
from esfo_backend.initialise.axis_search import search_axis
from esfo_backend.initialise.initialisation import Initialisation
from esfo_backend.options import InitialisationOptions
from esfo_backend.orbit.observations import Observations
from esfo_backend.orbit.parametrization import Motion
from esfo_backend.orbit.projection import row_errors
from esfo_backend.orbit.selection import longest_points
from esfo_core.orbit import Vector

_LARGEST_ERROR_PX = 1e4
"""Of a row behind the camera."""


@dataclass(frozen=True)
class RateComparison:
    """How the tracks fit another rate than the estimated one.

    z: by how many standard errors they fit the estimated rate better; negative: they fit the other one better.
    cost_ratio: robust cost at the other rate over that at the estimated one.
    """

    rate_hz: float
    z: float
    cost_ratio: float


def compare_rates(
    motion: Motion, obs: Observations, others_hz: Iterable[float], options: InitialisationOptions
) -> tuple[RateComparison, ...]:
    """Compare the rate of a motion with others. obs: one landmark per track.

    A rate at which no axis explains the tracks is left out.
    """
    sample = longest_points(obs, options.search_tracks)
    own = track_costs(_held(motion, sample, options), sample, options.cauchy_px)
    found = []
    for rate_hz in others_hz:
        try:
            other = search_axis(sample, rate_hz, options).best
        except BackendError:
            continue
        cost = track_costs(other, sample, options.cauchy_px)
        found.append(RateComparison(rate_hz, vuong_z(own, cost), float(cost.sum() / max(own.sum(), 1e-12))))
    return tuple(found)


def second_axis_z(initialisation: Initialisation, obs: Observations, options: InitialisationOptions) -> float:
    """By how many standard errors the tracks fit the axis better than the next best one; infinite where there is none.

    obs: one landmark per track, of the initialisation.
    """
    second = initialisation.second
    if second is None:
        return float("inf")
    own = track_costs(initialisation.solution, obs, options.cauchy_px)
    return vuong_z(own, track_costs(second, obs, options.cauchy_px))


def _held(motion: Motion, sample: Observations, options: InitialisationOptions) -> OrbitSolution:
    """Best axis and landmarks of the sample at the rate of the motion, from its axis."""
    return bundle_adjustment(motion, linear_points(motion, sample), sample, options.cauchy_px, False)


def track_costs(solution: OrbitSolution, obs: Observations, cauchy_px: float) -> Vector:
    """Cauchy cost (M,) of each of M tracks, px^2; each has a landmark of its own."""
    errors = row_errors(solution.motion.Q, solution.motion.rate_hz, solution.y, obs.rows) * obs.rows.weight
    return np.add.reduceat(cauchy_cost(errors, cauchy_px), obs.rows.first[:-1])


def cauchy_cost(errors: Vector, cauchy_px: float) -> Vector:
    """Cauchy cost (N,) of errors (N,) in px, px^2; infinite errors count as very large ones."""
    squared = np.minimum(errors, _LARGEST_ERROR_PX) ** 2
    return np.asarray(cauchy_px**2 / 2 * np.log1p(squared / cauchy_px**2))


def vuong_z(own: Vector, other: Vector) -> float:
    """By how many standard errors the costs `own` (M,) are lower than `other` (M,), in the mean."""
    difference = other - own
    spread = float(difference.std()) * np.sqrt(len(difference))
    return float(difference.sum() / spread) if spread > 0 else 0.0
