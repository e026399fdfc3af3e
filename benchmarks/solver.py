"""The solvers of the orbit side by side: CPU time per iteration from the same start to the same cost, in one run.

Least squares without a robust loss, because every solver has its own idea of one; the rows of the two that are used
show Cauchy's loss too. Ceres takes part where its Python bindings (pyceres) are installed.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import gtsam
import numpy as np
import scipy.optimize
import scipy.sparse
from numpy.typing import NDArray
from provenance import print_provenance

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution, bundle_adjustment, linear_points
from esfo_backend.adjustment.factor_graph import graph_values, optimise_graph, orbit_graph
from esfo_backend.initialise.axis_search import search_axis
from esfo_backend.initialise.colmap import cut_views, run_colmap
from esfo_backend.options import InitialisationOptions
from esfo_backend.orbit.observations import ObservationRows, Observations, observations
from esfo_backend.orbit.parametrization import Motion, motion_from_axis
from esfo_backend.orbit.projection import linearize_stack, project_row, robust_cost
from esfo_core.camera import Camera
from esfo_core.orbit import Matrix, Spin, Vector, angle_between, rotation
from esfo_simulation.tracks import SyntheticTrackOptions, synthetic_tracks

try:
    import pyceres
except ImportError:
    pyceres = None

FOCAL = 800.0
TURNS = 2.0
AXIS = np.array([0.3, -0.8, 0.4]) / np.linalg.norm([0.3, -0.8, 0.4])
RATE_HZ = 0.5
GOALS_MS = {"Schur": (5.0, 25.0), "graph": (30.0, 230.0)}


@dataclass(frozen=True)
class Run:
    """CPU seconds, iterations and final cost in px^2 of one solver."""

    seconds: float
    iterations: int
    cost: float


def problem(points: int, views: int) -> tuple[Observations, Motion]:
    """Every point of a transparent ball in every view, noise 0.5 px; the motion is off by 1 degree and 0.1 %."""
    rng = np.random.default_rng(0)
    motion = motion_from_axis(AXIS, np.array([0.02, 0.01, 1.0]), RATE_HZ)
    y = rng.normal(size=(points, 3))
    y *= 0.35 / np.linalg.norm(y, axis=1)[:, None]
    dt = np.linspace(-0.5, 0.5, views) * TURNS / RATE_HZ
    X = np.empty((points * views, 3))
    for k in range(len(X)):
        project_row(motion.Q, RATE_HZ, y[k // views], dt[k % views], X[k])
    xy = X[:, :2] / X[:, 2:] + 0.5 / FOCAL * rng.normal(size=(len(X), 2))
    first = np.arange(points + 1) * views
    rows = ObservationRows(np.tile(dt, points), xy, np.ones(len(X)), first, np.full(2, FOCAL))
    off = rotation(np.array([0.6, 0.0, 0.8]), np.radians(1.0))
    return Observations(rows, 0), Motion(off @ motion.Q, RATE_HZ * 1.001)


def cpu(work: Callable[[], tuple[int, float]]) -> Run:
    """Measure CPU seconds of this process."""
    begin = time.process_time()
    iterations, cost = work()
    return Run(time.process_time() - begin, iterations, cost)


def schur(start: OrbitSolution, obs: Observations, cauchy_px: float) -> tuple[int, float]:
    """Levenberg-Marquardt in numba with the points eliminated."""
    found = bundle_adjustment(start.motion, start.y, obs, cauchy_px)
    return found.iterations, found.cost


def graph(start: OrbitSolution, obs: Observations, cauchy_px: float) -> tuple[int, float]:
    """Levenberg-Marquardt around GTSAM's `linearize`; includes making the graph and its marginal."""
    found = optimise_graph(start, obs, cauchy_px, 50).solution
    return found.iterations, found.cost


def gtsam_own(start: OrbitSolution, obs: Observations) -> tuple[int, float]:
    """GTSAM's own Levenberg-Marquardt on the same factors."""
    optimiser = gtsam.LevenbergMarquardtOptimizer(orbit_graph(obs, 0.0), graph_values(start.motion, start.y))
    optimiser.optimize()
    return optimiser.iterations(), float(optimiser.error())


def right_jacobian(w: Vector) -> Matrix:
    """Derivative (3, 3) of log(exp(w)^-1 exp(w + d)) by d at 0: rotation vectors of a fixed start."""
    angle = float(np.linalg.norm(w))
    K = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    if angle < 1e-8:
        return np.eye(3) - 0.5 * K
    return np.asarray(np.eye(3) - (1 - np.cos(angle)) / angle**2 * K + (angle - np.sin(angle)) / angle**3 * (K @ K))


def turned(Q: Matrix, w: Vector) -> Matrix:
    """Q times the rotation of the vector w (3,)."""
    angle = float(np.linalg.norm(w))
    return Q @ rotation(w / angle, angle) if angle else Q


class ScipyProblem:
    """The same residuals and Jacobians for scipy: parameters are a rotation vector, the rate, then the points."""

    def __init__(self, start: OrbitSolution, obs: Observations) -> None:
        self.initialisation, self.obs = start, obs
        point = np.repeat(obs.point_index(), 2)
        motion = np.tile(np.arange(4), (len(point), 1))
        self.columns = np.hstack([motion, 4 + 3 * point[:, None] + np.arange(3)])
        self.offsets = np.arange(0, self.columns.size + 1, 7)

    def stack(self, p: Vector) -> Matrix:
        """Residuals and Jacobian blocks of all points, (2N, 8)."""
        Q, y = turned(self.initialisation.motion.Q, p[:3]), p[4:].reshape(-1, 3)
        blocks = [linearize_stack(Q, p[3], y[j], self.obs.of_point(j), 0.0, 1) for j in range(len(y))]
        return np.concatenate(blocks)

    def residuals(self, p: Vector) -> Vector:
        """All residuals, (2N,)."""
        return self.stack(p)[:, 0]

    def jacobian(self, p: Vector) -> scipy.sparse.csr_matrix:
        """Sparse Jacobian, (2N, 4 + 3P)."""
        J = self.stack(p)[:, 1:]
        J[:, :3] = J[:, :3] @ right_jacobian(p[:3])
        return scipy.sparse.csr_matrix((J.ravel(), self.columns.ravel(), self.offsets))

    def solve(self) -> tuple[int, float]:
        """Trust region with sparse analytic Jacobians."""
        p = np.concatenate([np.zeros(3), [self.initialisation.motion.rate_hz], self.initialisation.y.ravel()])
        found = scipy.optimize.least_squares(self.residuals, p, self.jacobian, x_scale="jac", ftol=1e-10)
        return int(found.njev), float(found.cost)


def ceres(start: OrbitSolution, obs: Observations) -> tuple[int, float]:
    """Ceres with one Python cost function per point and its Schur solver."""
    Q = start.motion.Q

    class PointCost(pyceres.CostFunction):  # type: ignore[misc]
        """All rows of one point."""

        def __init__(self, rows: ObservationRows) -> None:
            super().__init__()
            self.rows = rows
            self.set_num_residuals(2 * len(rows.dt))
            self.set_parameter_block_sizes([3, 1, 3])

        def Evaluate(
            self, parameters: list[Vector], residuals: Vector, jacobians: list[NDArray[np.float64]] | None
        ) -> bool:
            w, rate, y = parameters
            stack = linearize_stack(turned(Q, w), rate[0], np.ascontiguousarray(y), self.rows, 0.0, 1)
            residuals[:] = stack[:, 0]
            if jacobians is not None:
                blocks = (stack[:, 1:4] @ right_jacobian(w), stack[:, 4:5], stack[:, 5:8])
                for into, block in zip(jacobians, blocks, strict=True):
                    if into is not None:
                        into[:] = block.ravel()
            return True

    w, rate, y = np.zeros(3), np.array([start.motion.rate_hz]), [np.array(row) for row in start.y]
    costs = [PointCost(obs.of_point(j)) for j in range(obs.points)]
    task = pyceres.Problem()
    for j, cost in enumerate(costs):
        task.add_residual_block(cost, None, [w, rate, y[j]])
    options = pyceres.SolverOptions()
    options.linear_solver_type = pyceres.LinearSolverType.DENSE_SCHUR
    options.num_threads = 1
    options.function_tolerance = 1e-10
    options.minimizer_progress_to_stdout = False
    summary = pyceres.SolverSummary()
    pyceres.solve(options, task, summary)
    final = robust_cost(turned(Q, w), float(rate[0]), np.array(y), obs.rows, 0.0)
    return summary.num_successful_steps + summary.num_unsuccessful_steps, float(final)


def compare(points: int, views: int, repeats: int) -> None:
    """Print one table."""
    obs, motion = problem(points, views)
    start = OrbitSolution(motion, linear_points(motion, obs), 0.0, 0)
    solvers: dict[str, Callable[[], tuple[int, float]]] = {
        "Schur": lambda: schur(start, obs, 0.0),
        "graph": lambda: graph(start, obs, 0.0),
        "gtsam's own optimiser": lambda: gtsam_own(start, obs),
        "scipy least_squares": lambda: ScipyProblem(start, obs).solve(),
        "Schur, Cauchy 1 px": lambda: schur(start, obs, 1.0),
        "graph, Cauchy 1 px": lambda: graph(start, obs, 1.0),
    }
    if pyceres is not None:
        solvers["pyceres"] = lambda: ceres(start, obs)
    print(f"\n{points} points x {views} views, {len(obs.rows.dt)} observations:\n")
    print("| solver | CPU ms per iteration | relative to Schur | iterations | final cost, px^2 | goal, ms |")
    print("|---|---|---|---|---|---|")
    base = 0.0
    for name, work in solvers.items():
        few = 1 if name.startswith(("gtsam", "scipy")) else repeats
        runs = [cpu(work) for _ in range(few)]
        each = statistics.median(1e3 * r.seconds / r.iterations for r in runs)
        base = base or each
        goal = GOALS_MS.get(name, ("", ""))[views > 60]
        print(f"| {name} | {each:.1f} | {each / base:.1f} | {runs[0].iterations} | {runs[0].cost:.6f} | {goal} |")


def initialisation() -> None:
    """Time both starts on 300 tracks in each of 120 views, and look whether they give the same bits twice."""
    motion = Spin(AXIS, RATE_HZ, np.array([0.1, 0.05, 4.0]), 0)
    camera = Camera.pinhole(640, 480, FOCAL)
    ball = SyntheticTrackOptions(points=1700, duration_s=3.6, track_s=0.6, noise_px=0.5)
    tracks = synthetic_tracks(motion, camera, ball).tracks
    obs, _ = observations(tracks, camera, 4)
    views = [len(t) for t in cut_views(tracks, camera, 0.03).track]
    print(f"\nInitialisation, {len(views)} views of {np.mean(views):.0f} tracks, {obs.points} tracks in all:\n")
    print("| method | CPU s (goal: 3) | axis error, deg | bit-identical in two runs |\n|---|---|---|---|")
    starts: dict[str, Callable[[], Matrix]] = {
        "axis search": lambda: search_axis(obs, RATE_HZ, InitialisationOptions()).best.motion.Q,
        "COLMAP": lambda: run_colmap(tracks, camera, InitialisationOptions()).orbit.motion.Q,
    }
    for name, start in starts.items():
        begin = time.process_time()
        once = start()
        seconds = time.process_time() - begin
        same = once.tobytes() == start().tobytes()
        off = angle_between(-once[:, 2], AXIS)
        print(f"| {name} | {seconds:.2f} | {off:.2f} | {'yes' if same else 'no'} |")


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5, help="runs of the fast solvers, of which the median counts")
    repeats = parser.parse_args().repeats
    print_provenance()
    tiny, motion = problem(20, 10)
    compiled = bundle_adjustment(motion, linear_points(motion, tiny), tiny, 1.0)
    optimise_graph(compiled, tiny, 1.0, 2)
    if pyceres is None:
        print("Without Ceres: pyceres is not installed.")
    for points, views in ((300, 60), (2000, 100)):
        compare(points, views, repeats)
    initialisation()


if __name__ == "__main__":
    main()
