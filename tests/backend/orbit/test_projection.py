"""Kernels of the orbit model against their slow twins and against numeric differentiation."""

import numpy as np
import pytest
from scenes import CAMERA, spin, tracks_of, unit

from esfo_backend.adjustment.bundle_adjustment import normal_equations
from esfo_backend.orbit.observations import ObservationRows, observations
from esfo_backend.orbit.parametrization import Motion, motion_from_axis, spin_and_points
from esfo_backend.orbit.projection import (
    BEHIND_CAMERA_COST,
    _place_on_ray,
    cauchy_weight,
    linearize_row,
    linearize_stack,
    project_row,
    robust_cost,
    row_errors,
    triangulate,
)
from esfo_core.orbit import rotation


def camera_point(Q, rate, y, dt):
    """Slow twin of project_row: X = Q (Rz(-theta) y - e_x)."""
    return Q @ (rotation(np.array([0.0, 0, 1]), -2 * np.pi * rate * dt) @ y - np.array([1.0, 0, 0]))


def random_problem(seed):
    rng = np.random.default_rng(seed)
    Q = motion_from_axis(unit(*rng.normal(size=3)), np.array([0.05, -0.1, 1.0]), 0.5).Q
    y = Q.T @ np.array([0.0, 0, 0.1]) + 0.3 * rng.normal(size=(4, 3))
    y[:, 2] += Q[2, 2] * 2
    first = np.array([0, 3, 5, 9, 12])
    rows = ObservationRows(
        rng.uniform(-2, 2, 12), rng.normal(size=(12, 2)) * 0.2, rng.uniform(0.2, 1, 12), first, np.array([800.0, 750.0])
    )
    return Q, 0.5, y, rows


@pytest.mark.parametrize("seed", range(5))
def test_projection_equals_its_twin(seed):
    Q, rate, y, rows = random_problem(seed)
    X = np.empty(3)
    for dt in rows.dt:
        project_row(Q, rate, y[0], dt, X)
        np.testing.assert_allclose(X, camera_point(Q, rate, y[0], dt), rtol=0, atol=1e-13)


@pytest.mark.parametrize("seed", range(5))
def test_jacobians_equal_numeric_ones(seed):
    Q, rate, y, rows = random_problem(seed)

    def residual(delta, k, j):
        angle = np.linalg.norm(delta[:3])
        turn = rotation(delta[:3] / angle, angle) if angle else np.eye(3)
        X = camera_point(Q @ turn, rate + delta[3], y[j] + delta[4:], rows.dt[k])
        return rows.focal * rows.weight[k] * (X[:2] / X[2] - rows.xy[k])

    out = np.zeros((2, 8))
    checked = 0
    for j in range(4):
        for k in range(rows.first[j], rows.first[j + 1]):
            if not linearize_row(Q, rate, y[j], rows, k, out):
                assert camera_point(Q, rate, y[j], rows.dt[k])[2] < 1e-3
                continue
            if camera_point(Q, rate, y[j], rows.dt[k])[2] < 0.2:
                continue  # numeric differentiation is poor so close to the camera
            checked += 1
            np.testing.assert_allclose(out[:, 0], residual(np.zeros(7), k, j), rtol=1e-12, atol=1e-9)
            h = 1e-6
            for m in range(7):
                step = h * np.eye(7)[m]
                numeric = (residual(step, k, j) - residual(-step, k, j)) / (2 * h)
                np.testing.assert_allclose(out[:, 1 + m], numeric, rtol=1e-7, atol=1e-7 * np.abs(out[:, 1:]).max())
    assert checked > 5


def test_cost_counts_rows_behind_the_camera():
    Q, rate, y, rows = random_problem(0)
    y[1] = Q.T @ np.array([0, 0, -5.0])
    errors = row_errors(Q, rate, y, rows)
    behind = np.isinf(errors)
    q = (errors[~behind] * rows.weight[~behind]) ** 2
    assert behind.any()
    expected = 0.5 * 4 * np.log1p(q / 4).sum() + BEHIND_CAMERA_COST * behind.sum()
    assert robust_cost(Q, rate, y, rows, 2.0) == pytest.approx(expected, rel=1e-12)
    assert robust_cost(Q, rate, y, rows, 0.0) == pytest.approx(
        0.5 * q.sum() + BEHIND_CAMERA_COST * behind.sum(), rel=1e-12
    )


@pytest.mark.parametrize("power", [1, 2])
def test_normal_equations_are_those_of_the_stacked_rows(power):
    Q, rate, y, rows = random_problem(3)
    H = normal_equations(Q, rate, y, rows, 1.5, power)
    for j in range(4):
        part = slice(rows.first[j], rows.first[j + 1])
        own = ObservationRows(
            rows.dt[part], rows.xy[part], rows.weight[part], np.array([0, part.stop - part.start]), rows.focal
        )
        J = linearize_stack(Q, rate, y[j], own, 1.5, power)
        np.testing.assert_allclose(H.pp[j], J[:, 5:].T @ J[:, 5:], rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(H.m[j], J[:, 1:5].T @ J[:, 0], rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(H.mp[j], J[:, 1:5].T @ J[:, 5:], rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("cauchy", [0.0, 1e-3, 2.0])
def test_normal_equations_know_the_cost(cauchy):
    Q, rate, y, rows = random_problem(0)
    y[1] = Q.T @ np.array([0, 0, -5.0])  # behind the camera
    for power in (1, 2):
        found = normal_equations(Q, rate, y, rows, cauchy, power).cost
        assert found == pytest.approx(robust_cost(Q, rate, y, rows, cauchy), rel=1e-12)


def test_weight_is_the_derivative_of_the_loss():
    c, h = 2.0, 1e-6
    for r in (0.1, 1.0, 7.0):
        block = np.zeros((2, 8))
        block[0, 0] = r
        slope = (np.log1p((r + h) ** 2 / c**2) - np.log1p((r - h) ** 2 / c**2)) * c**2 / 2 / (2 * h)
        assert cauchy_weight(block, c) * r == pytest.approx(slope, rel=1e-7)


def test_triangulation_recovers_exact_points():
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)))
    obs, ids = observations(scene.tracks, CAMERA, 4)
    motion = motion_from_axis(scene.spin.axis, scene.spin.center, 0.5)
    y = triangulate(motion.Q, 0.5, obs.rows)
    found, points = spin_and_points(Motion(motion.Q, 0.5), y, obs.t_ref, scene.spin.t0)
    radius = np.linalg.norm(scene.spin.center - scene.spin.axis * (scene.spin.center @ scene.spin.axis))
    # Compared as points of the camera frame at t0: the centre along the axis is a convention.
    truth = (scene.points[scene.point_of_track[ids]] + scene.spin.center) / radius
    # float32 pixels, good to 3e-5 px, and short tracks, whose depth is some hundred times less certain
    np.testing.assert_allclose(points + found.center, truth, atol=2e-4)


def test_a_point_placed_on_its_ray_is_the_nearest_to_the_axis():
    """Tracks that move against the rotation have their linear solution behind the camera."""
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)))
    obs, _ = observations(scene.tracks, CAMERA, 4)
    Q = motion_from_axis(scene.spin.axis, scene.spin.center, 0.5).Q
    rows, X, y = obs.rows, np.empty(3), np.empty(3)
    for j in range(0, obs.points, 10):
        k = int(rows.first[j]) + 1
        _place_on_ray(Q, 0.5, rows, k, y)
        project_row(Q, 0.5, y, rows.dt[k], X)
        np.testing.assert_allclose(X[:2] / X[2], rows.xy[k], atol=1e-9)
        assert X[2] > 0

        def from_axis(scale, X=X):
            """Distance of the point at `scale` times the depth from the axis: it turns about z, at (1, 0) from Q."""
            return np.hypot(*((Q.T @ (scale * X))[:2] + np.array([1.0, 0.0])))

        assert from_axis(1.0) == pytest.approx(np.hypot(y[0], y[1]), rel=1e-9)
        assert from_axis(1.0) < min(from_axis(0.99), from_axis(1.01))
