"""The factor graph over the orbit (paper, section 5.2) in GTSAM, in the minimal gauge of `parametrization`.

The Schur solver of `bundle_adjustment` does the search because it is fast; GTSAM's graph stays the last stage because
results and covariances are promised from it.

Variables: Q as Rot3, the rate as a vector of one, one Point3 per landmark. One factor per landmark stacks all its
observations with analytic Jacobians. GTSAM's own optimisers copy all values at each call of a Python factor;
`linearize` does not, so the Levenberg-Marquardt loop is written here around it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import F, L, Q

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution
from esfo_backend.orbit.observations import ObservationRows, Observations
from esfo_backend.orbit.parametrization import Motion
from esfo_backend.orbit.projection import linearize_stack, robust_cost
from esfo_core.orbit import Matrix, Vector

_ROTATION, _RATE = Q(0), F(0)
_LARGEST_DAMPING = 1e8
_RELATIVE_GAIN = 1e-10

ErrorFunction = Callable[[gtsam.CustomFactor, gtsam.Values, list[Matrix] | None], Vector]


@dataclass(frozen=True)
class GraphOptimum:
    """Optimum of the graph and the covariance of its motion.

    marginal: (4, 4), GTSAM's marginal covariance of (right rotation vector of Q, rate) for unit variance of a residual.
    """

    solution: OrbitSolution
    marginal: Matrix


def orbit_factor(point: int, rows: ObservationRows, cauchy_px: float, power: int = 1) -> gtsam.CustomFactor:
    """Return the orbit factor (paper, figure 4) of one landmark: all its observations, whitened and robustly weighted.

    rows: observations of this landmark. power: see `linearize_stack`.
    """

    def error(_: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Matrix] | None) -> Vector:
        R, rate = values.atRot3(_ROTATION).matrix(), float(values.atVector(_RATE)[0])
        stack = linearize_stack(R, rate, values.atPoint3(L(point)), rows, cauchy_px, power)
        if jacobians is not None:
            # GTSAM keeps the arrays and wants them contiguous by column.
            jacobians[0] = np.asfortranarray(stack[:, 1:4])
            jacobians[1] = np.asfortranarray(stack[:, 4:5])
            jacobians[2] = np.asfortranarray(stack[:, 5:8])
        return np.ascontiguousarray(stack[:, 0])

    unit = gtsam.noiseModel.Unit.Create(2 * len(rows.dt))
    return gtsam.CustomFactor(unit, [_ROTATION, _RATE, L(point)], error)


def orbit_graph(obs: Observations, cauchy_px: float, power: int = 1) -> gtsam.NonlinearFactorGraph:
    """Return the graph with one orbit factor per landmark."""
    graph = gtsam.NonlinearFactorGraph()
    for j in range(obs.points):
        graph.push_back(orbit_factor(j, obs.of_point(j), cauchy_px, power))
    return graph


def graph_values(motion: Motion, y: Matrix) -> gtsam.Values:
    """Pack motion and landmarks (P, 3) into GTSAM values."""
    values = gtsam.Values()
    values.insert(_ROTATION, gtsam.Rot3(motion.Q))
    values.insert(_RATE, np.array([motion.rate_hz]))
    for j, point in enumerate(y):
        values.insert(L(j), point)
    return values


def _unpack(values: gtsam.Values, points: int) -> tuple[Matrix, float, Matrix]:
    y = np.array([values.atPoint3(L(j)) for j in range(points)]).reshape(points, 3)
    return values.atRot3(_ROTATION).matrix(), float(values.atVector(_RATE)[0]), y


def optimise_graph(initial: OrbitSolution, obs: Observations, cauchy_px: float, iterations: int) -> GraphOptimum:
    """Minimise the robust reprojection error over the whole graph, from the initial values."""
    graph = orbit_graph(obs, cauchy_px)
    ordering = gtsam.Ordering()
    for j in range(obs.points):
        ordering.push_back(L(j))
    ordering.push_back(_ROTATION)
    ordering.push_back(_RATE)

    def cost_of(at: gtsam.Values) -> float:
        return float(robust_cost(*_unpack(at, obs.points), obs.rows, cauchy_px))

    values = graph_values(initial.motion, initial.y)
    cost, damping, used = cost_of(values), 1e-6, 0
    while used < iterations:
        used += 1
        linear = graph.linearize(values)
        previous = cost
        while damping < _LARGEST_DAMPING:
            trial = _damped_step(linear, values, ordering, damping)
            trial_cost = np.inf if trial is None else cost_of(trial)
            if trial is not None and trial_cost < cost:
                values, cost = trial, trial_cost
                damping = max(damping / 10, 1e-10)
                break
            damping *= 10
        if previous - cost <= _RELATIVE_GAIN * previous:
            break
    rotation, rate, y = _unpack(values, obs.points)
    optimum = OrbitSolution(Motion(rotation, rate), y, cost, used)
    return GraphOptimum(optimum, motion_marginal(values, obs, cauchy_px))


def _damped_step(
    linear: gtsam.GaussianFactorGraph, values: gtsam.Values, ordering: gtsam.Ordering, damping: float
) -> gtsam.Values | None:
    """One Levenberg-Marquardt step with additive damping; None where the system is indeterminate."""
    damped = gtsam.GaussianFactorGraph()
    damped.push_back(linear)
    root = np.sqrt(damping)
    for k in range(ordering.size()):
        key = ordering.at(k)
        size = 1 if key == _RATE else 3
        unit = gtsam.noiseModel.Unit.Create(size)
        damped.push_back(gtsam.JacobianFactor(key, root * np.eye(size), np.zeros(size), unit))
    try:
        return values.retract(damped.optimize(ordering))
    except RuntimeError:
        return None


def motion_marginal(values: gtsam.Values, obs: Observations, cauchy_px: float) -> Matrix:
    """Marginal covariance (4, 4) of (rotation vector of Q, rate), all landmarks eliminated; NaN where indeterminate.

    Linearised with the mean second derivative of the robust loss (power 2), as the information requires.
    """
    try:
        marginals = gtsam.Marginals(orbit_graph(obs, cauchy_px, 2), values)
        joint = marginals.jointMarginalCovariance([_ROTATION, _RATE])
    except RuntimeError:
        return np.full((4, 4), np.nan)
    return np.block(
        [
            [joint.at(_ROTATION, _ROTATION), joint.at(_ROTATION, _RATE)],
            [joint.at(_RATE, _ROTATION), joint.at(_RATE, _RATE)],
        ]
    )
