"""The Schur solver and the GTSAM graph: same optimum, right covariance, exact recovery."""

import gtsam
import numpy as np
import pytest
from scenes import CAMERA, spin, tracks_of, unit

from esfo_backend.adjustment import bundle_adjustment as adjust_module
from esfo_backend.adjustment import factor_graph as graph_module
from esfo_backend.adjustment.bundle_adjustment import (
    OrbitSolution,
    _step,
    bundle_adjustment,
    linear_points,
    normal_equations,
)
from esfo_backend.adjustment.covariance import motion_covariance, schur_marginal
from esfo_backend.adjustment.factor_graph import graph_values, optimise_graph, orbit_factor
from esfo_backend.orbit.observations import observations
from esfo_backend.orbit.parametrization import motion_from_axis
from esfo_backend.orbit.projection import row_errors
from esfo_core.orbit import angle_between, rotation, tangent_basis
from esfo_core.tracks import Tracks

AXES = [unit(0, 1, 0), unit(1, 0, 0), unit(0.3, -0.8, 0.4), unit(-0.5, -0.5, 0.7), unit(0.1, 0.5, -0.85)]


def perturbed(motion_spin, rate_error):
    axis = rotation(unit(1, 1, 1), 0.1) @ motion_spin.axis
    return motion_from_axis(axis, motion_spin.center, motion_spin.rate_hz * (1 + rate_error))


@pytest.mark.parametrize("axis", AXES)
def test_exact_tracks_are_recovered(axis):
    scene = tracks_of(spin(axis))
    obs, _ = observations(scene.tracks, CAMERA, 4)
    start = perturbed(scene.spin, 1e-3)
    solved = bundle_adjustment(start, linear_points(start, obs), obs, 1.0)
    assert solved.motion.rate_hz == pytest.approx(0.5, rel=1e-6)
    assert angle_between(solved.motion.axis, axis) < 1e-4


def test_graph_and_schur_solver_reach_the_same_optimum(monkeypatch):
    scene = tracks_of(spin(AXES[2]), noise_px=0.5, outliers=0.1)
    obs, _ = observations(scene.tracks, CAMERA, 4)
    start = perturbed(scene.spin, 0.0)
    rough = bundle_adjustment(start, linear_points(start, obs), obs, 1.0, iterations=5)
    for solver in (adjust_module, graph_module):  # reweighted steps converge linearly: on until no step gains any more
        monkeypatch.setattr(solver, "_RELATIVE_GAIN", 0.0)
    fast = bundle_adjustment(rough.motion, rough.y, obs, 1.0, iterations=1000)
    graph = optimise_graph(rough, obs, 1.0, 1000).solution
    assert graph.cost == pytest.approx(fast.cost, rel=1e-12)
    assert graph.motion.rate_hz == pytest.approx(fast.motion.rate_hz, rel=1e-8)
    np.testing.assert_allclose(graph.motion.Q, fast.motion.Q, atol=1e-8)


def test_jacobians_of_a_factor_equal_numeric_ones():
    """By retraction, as GTSAM moves its values: of the rotation, the rate and the point of the stacked factor."""
    scene = tracks_of(spin(AXES[2]), noise_px=0.5, points=6)
    obs, _ = observations(scene.tracks, CAMERA, 4)
    motion = perturbed(scene.spin, 1e-3)
    y = linear_points(motion, obs)
    values = graph_values(motion, y)
    for j in range(obs.points):
        factor = orbit_factor(j, obs.of_point(j), 0.0)
        A, b = factor.linearize(values).jacobian()
        columns = []
        for key, size in zip(factor.keys(), (3, 1, 3), strict=True):
            for m in range(size):

                def residual(s, key=key, size=size, m=m, factor=factor, h=1e-4):
                    moved = gtsam.VectorValues()
                    moved.insert(key, s * h * np.eye(size)[m])
                    return factor.unwhitenedError(values.retract(moved))

                columns.append((residual(-2) - 8 * residual(-1) + 8 * residual(1) - residual(2)) / 12e-4)
        np.testing.assert_allclose(A, np.transpose(columns), rtol=1e-7, atol=1e-7 * np.abs(A).max())
        np.testing.assert_allclose(-b, factor.unwhitenedError(values))


def test_schur_step_is_that_of_the_whole_system():
    """The eliminated system against a dense solve of all unknowns."""
    scene = tracks_of(spin(AXES[2]), noise_px=0.3, points=12)
    obs, _ = observations(scene.tracks, CAMERA, 4)
    motion = perturbed(scene.spin, 1e-3)
    H = normal_equations(motion.Q, motion.rate_hz, linear_points(motion, obs), obs.rows, 2.0, 1)
    damping = 1e-3
    for free_rate in (True, False):
        dm, dp, gain = _step(H, damping, free_rate)
        full, gradient = whole_system(H), np.concatenate([H.m.sum(axis=0), H.p.ravel()])
        regular = np.full(len(full), 1e-9)
        regular[:4] = 1e-12
        free = np.arange(len(full)) != (-1 if free_rate else 3)
        damped = full + np.diag(damping * np.diag(full) + regular)
        expected = np.zeros(len(full))
        expected[free] = -np.linalg.solve(damped[np.ix_(free, free)], gradient[free])
        np.testing.assert_allclose(dm, expected[:4], rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(dp.ravel(), expected[4:], rtol=1e-6, atol=1e-9 * np.abs(expected).max())
        assert gain == pytest.approx(-0.5 * gradient @ expected, rel=1e-8)


def whole_system(H):
    P = len(H.p)
    full = np.zeros((4 + 3 * P, 4 + 3 * P))
    full[:4, :4] = H.mm
    for j in range(P):
        own = slice(4 + 3 * j, 7 + 3 * j)
        full[:4, own], full[own, :4], full[own, own] = H.mp[j], H.mp[j].T, H.pp[j]
    return full


def test_marginal_is_the_inverse_of_the_whole_information_matrix():
    scene = tracks_of(spin(AXES[2]), noise_px=0.3, points=12)
    obs, _ = observations(scene.tracks, CAMERA, 4)
    start = perturbed(scene.spin, 0.0)
    solved = bundle_adjustment(start, linear_points(start, obs), obs, 2.0)
    result = optimise_graph(solved, obs, 2.0, 1)
    best = result.solution
    H = normal_equations(best.motion.Q, best.motion.rate_hz, best.y, obs.rows, 2.0, 2)
    expected = np.linalg.inv(whole_system(H))[:4, :4]
    np.testing.assert_allclose(result.marginal, expected, rtol=1e-5, atol=1e-9 * np.abs(expected).max())


def test_reported_deviations_are_honest():
    """Over many seeds the squared error over the variance has mean 1 (rate) and 2 (axis), within sampling error."""
    z2_rate, z2_axis = [], []
    for seed in range(25):
        scene = tracks_of(spin(AXES[2]), noise_px=0.5, points=40, seed=seed)
        obs, _ = observations(scene.tracks, CAMERA, 4)
        start = motion_from_axis(scene.spin.axis, scene.spin.center, 0.5)
        result = optimise_graph(bundle_adjustment(start, linear_points(start, obs), obs, 1.0), obs, 1.0, 20)
        motion = result.solution.motion
        cov = motion_covariance(result.solution, obs, result.marginal, 1.0)
        z2_rate.append(((motion.rate_hz - 0.5) / cov.rate_std_hz) ** 2)
        off = tangent_basis(motion.axis).T @ scene.spin.axis
        z2_axis.append(off @ np.linalg.solve(cov.axis_cov, off))
    # The mean of 25 chi-squared values of 1 (2) degrees of freedom has a deviation of 0.28 (0.4); the covariance may be
    # cautious by up to a factor two in variance, never bold by more than three sampling deviations.
    assert 0.3 < np.mean(z2_rate) < 1 + 3 * 0.28
    assert 0.6 < np.mean(z2_axis) < 2 + 3 * 0.4


@pytest.mark.parametrize("axis", [AXES[2], AXES[3]])
def test_stated_correlation_of_the_axis_is_that_of_its_errors(axis):
    """The two components of the axis in its tangent plane: about -0.1 for one axis, 0.75 for the other."""
    errors, stated = [], []
    for seed in range(40):
        scene = tracks_of(spin(axis), noise_px=0.5, points=40, seed=seed)
        obs, _ = observations(scene.tracks, CAMERA, 4)
        start = motion_from_axis(axis, scene.spin.center, 0.5)
        solved = bundle_adjustment(start, linear_points(start, obs), obs, 1.0)
        errors.append(tangent_basis(axis).T @ solved.motion.axis)
        stated.append(motion_covariance(solved, obs, schur_marginal(solved, obs, 1.0), 1.0).axis_cov)
    shown, mean = np.cov(np.transpose(errors)), np.mean(stated, axis=0)
    assert shown[0, 1] / np.sqrt(shown[0, 0] * shown[1, 1]) == pytest.approx(
        mean[0, 1] / np.sqrt(mean[0, 0] * mean[1, 1]), abs=0.35
    )


def test_deviations_are_at_least_those_of_independent_residuals():
    """With few points the scatter of their scores may be small by chance; least squares: the textbook's deviation."""
    for seed in range(12):
        scene = tracks_of(spin(AXES[2]), noise_px=0.5, points=8, seed=seed)
        obs, _ = observations(scene.tracks, CAMERA, 4)
        start = motion_from_axis(AXES[2], scene.spin.center, 0.5)
        solved = bundle_adjustment(start, linear_points(start, obs), obs, 0.0)
        marginal = schur_marginal(solved, obs, 0.0)
        errors = obs.rows.weight * row_errors(solved.motion.Q, solved.motion.rate_hz, solved.y, obs.rows)
        variance = (errors**2).sum() / (2 * len(errors) - 3 * obs.points - 4)
        found = motion_covariance(solved, obs, marginal, 0.0)
        assert found.rate_std_hz >= np.sqrt(variance * marginal[3, 3]) * (1 - 1e-9)


def test_rows_count_by_their_sigma():
    """A third of the rows is off by 4 px: least squares with their sigma is twice as good as without, and better."""
    known, unknown = [], []
    for seed in range(8):
        scene = tracks_of(spin(AXES[2]), noise_px=0.2, seed=seed)
        rng = np.random.default_rng(seed)
        tracks = scene.tracks
        sigma = np.where(rng.random(len(tracks)) < 1 / 3, 4.0, 0.2).astype(np.float32)
        uv = (tracks.uv + rng.normal(size=tracks.uv.shape) * np.where(sigma > 1, 4.0, 0.0)[:, None]).astype(np.float32)
        for told, errors in ((sigma, known), (np.full_like(sigma, 0.2), unknown)):
            obs, _ = observations(Tracks(tracks.track_id, tracks.t, uv, told), CAMERA, 4)
            start = motion_from_axis(AXES[2], scene.spin.center, 0.5)
            solved = bundle_adjustment(start, linear_points(start, obs), obs, 0.0, free_rate=False)
            errors.append(angle_between(solved.motion.axis, AXES[2]))
    assert np.mean(np.square(known)) < 0.25 * np.mean(np.square(unknown))


@pytest.mark.parametrize("axis", [AXES[2], AXES[3]])
def test_axis_covariance_is_that_of_turned_orbits(axis):
    """A right rotation of Q about x and y with a correlation of 0.6 moves the axis with that of turned orbits.

    The scales of both are measured, and are divided out.
    """
    scene = tracks_of(spin(axis), noise_px=0.3, points=20)
    obs, _ = observations(scene.tracks, CAMERA, 4)
    motion = motion_from_axis(axis, scene.spin.center, 0.5)
    solution = OrbitSolution(motion, linear_points(motion, obs), 0.0, 0)
    marginal = np.eye(4)
    marginal[0, 1] = marginal[1, 0] = 0.6
    found = motion_covariance(solution, obs, marginal, 1.0).axis_cov
    moved = []
    for d in (np.array([1.0, 0, 0]), np.array([0, 1.0, 0])):
        turned = motion_from_axis(axis, scene.spin.center, 0.5).Q @ rotation(d, 1e-6)
        moved.append(tangent_basis(axis).T @ (-turned[:, 2] + motion.Q[:, 2]) / 1e-6)
    back = np.linalg.inv(np.transpose(moved))
    cov = back @ found @ back.T  # of the rotation vector again
    assert cov[0, 1] / np.sqrt(cov[0, 0] * cov[1, 1]) == pytest.approx(0.6, rel=1e-5)
