"""Columns of the consider parameters against their definition, and deviations that know of a common bias."""

import numpy as np
import pytest
from scenes import CAMERA, spin, tracks_of, unit

from esfo_backend.adjustment.bundle_adjustment import bundle_adjustment, linear_points
from esfo_backend.adjustment.consider_bias import (
    BIAS,
    MOTION,
    SLOPE,
    _widen,
    reduced_equations,
    row_scores,
    sensitivity,
)
from esfo_backend.adjustment.covariance import motion_covariance
from esfo_backend.adjustment.factor_graph import optimise_graph
from esfo_backend.orbit.observations import observations
from esfo_backend.orbit.parametrization import motion_from_axis
from esfo_backend.orbit.projection import cauchy_weight, linearize_row
from esfo_core.events import NS_PER_S
from esfo_core.orbit import angle_between, rotation, tangent_basis
from esfo_core.tracks import Tracks

AXIS = unit(0.3, -0.8, 0.4)


def solved(tracks, point_of_track, center):
    obs, ids = observations(tracks, CAMERA, 4)
    _, label = np.unique(point_of_track[ids], return_inverse=True)
    obs = obs.regroup(label.astype(np.int64))
    start = motion_from_axis(AXIS, center, 0.5)
    return bundle_adjustment(start, linear_points(start, obs), obs, 1.0), obs


def sides_and_directions(scene, tracks):
    """Sine of the azimuth about the axis, from the camera on, (N,), and unit image velocity (N, 2)."""
    point = scene.points[scene.point_of_track[tracks.track_id]]
    perpendicular = scene.spin.center - (scene.spin.center @ AXIS) * AXIS
    u = -perpendicular / np.linalg.norm(perpendicular)
    side, direction = np.empty(len(tracks)), np.empty((len(tracks), 2))
    for k, t in enumerate(tracks.t):
        step = 1e-4 * NS_PER_S
        here, after = (scene.spin.transform(point[k : k + 1], int(t + s)) for s in (0, step))
        out = here[0] - scene.spin.center
        out -= (out @ AXIS) * AXIS
        side[k] = out @ np.cross(-AXIS, u) / np.linalg.norm(out)
        moved = CAMERA.project(after)[0] - CAMERA.project(here)[0]
        direction[k] = moved / np.linalg.norm(moved)
    return side, direction


def biased(scene, bias):
    """The tracks, with corners off by `bias` (4,) px."""
    tracks = scene.tracks
    side, along = sides_and_directions(scene, tracks)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    uv = tracks.uv + (bias[0] + bias[2] * side)[:, None] * along + (bias[1] + bias[3] * side)[:, None] * across
    return Tracks(tracks.track_id, tracks.t, uv.astype(np.float32), tracks.sigma)


@pytest.mark.parametrize("kind", range(4))
def test_sensitivity_is_what_a_biased_scene_shows(kind):
    scene = tracks_of(spin(AXIS), track_s=1.2)
    clean, obs = solved(scene.tracks, scene.point_of_track, scene.spin.center)
    information, _ = reduced_equations(clean.motion.Q, clean.motion.rate_hz, clean.y, obs.rows, 0.0, 1)
    expected = sensitivity(information.sum(axis=0), np.arange(4), np.arange(5, 9))[:, kind]
    size = 0.05
    off, _ = solved(biased(scene, size * np.eye(4)[kind]), scene.point_of_track, scene.spin.center)
    turned = clean.motion.Q.T @ off.motion.Q
    rotation = np.array([turned[2, 1], turned[0, 2], turned[1, 0]]) / size
    np.testing.assert_allclose(rotation, expected[:3], rtol=0.01, atol=0.01 * np.abs(expected[:3]).max())
    assert (off.motion.rate_hz - clean.motion.rate_hz) / size == pytest.approx(expected[3], rel=0.02, abs=1e-6)


def test_equations_are_those_of_the_rows():
    scene = tracks_of(spin(AXIS), noise_px=0.5, points=8)
    solution, obs = solved(scene.tracks, scene.point_of_track, scene.spin.center)
    Q, rate = solution.motion.Q, solution.motion.rate_hz
    information, score = reduced_equations(Q, rate, solution.y, obs.rows, 1.0, 1)
    block = np.empty((2, 8))
    for j in range(obs.points):
        rows = []
        for k in range(obs.rows.first[j], obs.rows.first[j + 1]):
            linearize_row(Q, rate, solution.y[j], obs.rows, k, block)
            slope = block[:, 4] * obs.rows.dt[k] / 2
            rows.append(np.sqrt(cauchy_weight(block, 1.0)) * np.column_stack([block[:, 1:5], slope, block[:, 5:]]))
            rows[-1] = np.column_stack([rows[-1], np.sqrt(cauchy_weight(block, 1.0)) * block[:, 0]])
        J = np.vstack(rows)
        motion, point, r = J[:, :5], J[:, 5:8], J[:, 8]
        left = motion - point @ np.linalg.lstsq(point, motion, rcond=None)[0]
        np.testing.assert_allclose(information[j, :5, :5], left.T @ left, rtol=1e-5, atol=1e-5 * (left**2).sum())
        np.testing.assert_allclose(score[j, :5], left.T @ r, rtol=1e-5, atol=1e-5 * np.abs(left).sum())
    assert (slice(0, 4), 4, slice(5, 9)) == (MOTION, SLOPE, BIAS)


def test_scores_of_rows_add_up_to_those_of_landmarks():
    scene = tracks_of(spin(AXIS), noise_px=0.5, points=8)
    solution, obs = solved(scene.tracks, scene.point_of_track, scene.spin.center)
    Q, rate = solution.motion.Q, solution.motion.rate_hz
    information, score = reduced_equations(Q, rate, solution.y, obs.rows, 1.0, 1)
    step = np.array([1e-3, -2e-3, 1e-3, 1e-4, 1e-4, 0.1, 0, 0, 0, 1e-3])
    for moved in (np.zeros(10), step):
        parts = row_scores(Q, rate, solution.y, obs.rows, 1.0, moved)
        summed = np.add.reduceat(parts, obs.rows.first[:-1])
        expected = score + information @ moved
        np.testing.assert_allclose(summed, expected, rtol=1e-7, atol=1e-8 * np.abs(expected).max())


def test_columns_equal_numeric_derivatives():
    """Of the slope by the phase that it adds, of the biases by shifts along and across a numeric image velocity."""
    scene = tracks_of(spin(AXIS), noise_px=0.5, points=8)
    solution, obs = solved(scene.tracks, scene.point_of_track, scene.spin.center)
    Q, rate, rows = solution.motion.Q, solution.motion.rate_hz, obs.rows

    def image(j, phase):
        X = Q @ (rotation(np.array([0.0, 0, 1]), -2 * np.pi * phase) @ solution.y[j] - [1.0, 0, 0])
        return rows.focal * X[:2] / X[2]

    def by_focal(j, k, h=1e-5):
        """Pixels are fixed: directions shrink as the focal length grows."""
        residual = [np.exp(s) * (image(j, rate * rows.dt[k]) - rows.focal * rows.xy[k] * np.exp(-s)) for s in (-h, h)]
        return (residual[1] - residual[0]) / (2 * h)

    block, wide = np.empty((2, 8)), np.empty((2, 14))
    for j in range(obs.points):
        for k in range(rows.first[j], rows.first[j + 1]):
            linearize_row(Q, rate, solution.y[j], rows, k, block)
            _widen(rate, solution.y[j], rows, k, block, wide)
            dt, h, w = rows.dt[k], 1e-5, rows.weight[k]
            change = [image(j, rate * dt + s * h) for s in (-2, -1, 1, 2)]
            by_phase = (change[0] - 8 * change[1] + 8 * change[2] - change[3]) / (12 * h)  # px per turn
            along = by_phase / np.linalg.norm(by_phase)
            across = np.array([-along[1], along[0]])
            y = rotation(np.array([0.0, 0, 1]), -2 * np.pi * rate * dt) @ solution.y[j]
            side = y[1] / np.hypot(y[0], y[1])
            expected = [w * by_phase * dt**2 / 2, *(w * v for v in (along, across, side * along, side * across))]
            expected.append(w * by_focal(j, k))
            size = np.abs(wide[:, 5:10]).max()
            np.testing.assert_allclose(wide[:, 5:11], np.transpose(expected), rtol=1e-7, atol=1e-7 * size)


def test_stated_deviation_covers_a_common_bias():
    """A quarter of a pixel of each kind moves the axis by less than three deviations, and by more than three of those
    that know of no bias."""
    rng = np.random.default_rng(4)
    unaware, aware = [], []
    for seed in range(6):
        scene = tracks_of(spin(AXIS), noise_px=0.1, seed=seed)
        tracks = biased(scene, 0.25 * rng.choice([-1, 1], 4))
        solution, obs = solved(tracks, scene.point_of_track, scene.spin.center)
        result = optimise_graph(solution, obs, 1.0, 20)
        axis = result.solution.motion.axis
        off = tangent_basis(axis).T @ AXIS
        for z, bias_px in ((unaware, 0.0), (aware, 0.25)):
            cov = motion_covariance(result.solution, obs, result.marginal, 1.0, bias_px).axis_cov
            z.append(np.sqrt(off @ np.linalg.solve(cov, off)))
        assert angle_between(axis, AXIS) < 1.0
    assert max(aware) < 3
    assert np.median(unaware) > 3
