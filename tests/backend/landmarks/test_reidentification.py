"""Tracks of one point are merged, tracks of two points are not."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import CAMERA, spin, tracks_of, unit

from esfo_backend.adjustment.bundle_adjustment import (
    OrbitSolution,
    bundle_adjustment,
    linear_points,
    normal_equations,
)
from esfo_backend.errors import BackendError
from esfo_backend.landmarks.landmarks import Landmarks, drop_far, prune, reobservable_points, reobserved_points
from esfo_backend.landmarks.reidentification import merge_round, point_rms, reidentify
from esfo_backend.options import BackendOptions, ReidentificationOptions
from esfo_backend.orbit.observations import observations
from esfo_backend.orbit.parametrization import motion_from_axis
from esfo_backend.orbit.projection import row_errors


@pytest.mark.parametrize("outliers", [0.0, 0.3])
def test_merged_tracks_share_their_true_point(outliers):
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)), noise_px=0.5, outliers=outliers)
    obs, ids = observations(scene.tracks, CAMERA, 4)
    motion = motion_from_axis(scene.spin.axis, scene.spin.center, 0.5)
    start = bundle_adjustment(motion, linear_points(motion, obs), obs, 2.0, free_rate=False)
    _, label = reidentify(start, obs, np.arange(obs.points), ReidentificationOptions(), 2.0, True)
    truth = scene.point_of_track[ids]
    groups = [truth[label == j] for j in range(label.max() + 1)]
    impure = sum(len(np.unique(g)) > 1 for g in groups)
    true_points = len(np.unique(truth[truth >= 0]))
    assert impure <= 0.02 * len(groups)
    assert true_points <= sum((g >= 0).any() for g in groups) <= 1.3 * true_points


def test_simultaneous_tracks_never_merge():
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)), noise_px=0.5)
    obs, _ = observations(scene.tracks, CAMERA, 4)
    motion = motion_from_axis(scene.spin.axis, scene.spin.center, 0.5)
    start = bundle_adjustment(motion, linear_points(motion, obs), obs, 2.0, free_rate=False)
    options = ReidentificationOptions(chi2=1e9, rms_px=1e9, neighbours=100)
    label = merge_round(start, obs, np.arange(obs.points), options, 2.0)
    begin, end = obs.rows.dt[obs.rows.first[:-1]], obs.rows.dt[obs.rows.first[1:] - 1]
    assert label.max() < obs.points - 1
    for j in range(label.max() + 1):
        members = np.flatnonzero(label == j)
        order = members[np.argsort(begin[members])]
        assert (begin[order[1:]] > end[order[:-1]]).all()


def test_points_beyond_the_camera_are_dropped_and_no_others():
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)))
    obs, _ = observations(scene.tracks, CAMERA, 4)
    motion = motion_from_axis(scene.spin.axis, scene.spin.center, 0.5)
    label = np.append(np.arange(obs.points), -1)
    whole = Landmarks(obs, bundle_adjustment(motion, linear_points(motion, obs), obs, 2.0), label)
    assert drop_far(whole) is whole
    y = whole.solution.y.copy()
    y[[3, 7]] *= 1e4
    found = drop_far(replace(whole, solution=replace(whole.solution, y=y)))
    kept = np.delete(np.arange(obs.points), [3, 7])
    np.testing.assert_array_equal(found.solution.y, y[kept])
    np.testing.assert_array_equal(found.obs.rows.dt, obs.rows.dt[np.isin(obs.point_index(), kept)])
    assert found.label[[3, 7, -1]].tolist() == [-1, -1, -1]
    np.testing.assert_array_equal(found.label[kept], np.arange(len(kept)))


def test_rms_is_per_point():
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)))
    obs, _ = observations(scene.tracks, CAMERA, 4)
    errors = np.arange(len(obs.rows.dt), dtype=float)
    slow = [np.sqrt(np.mean(errors[a:b] ** 2)) for a, b in zip(obs.rows.first, obs.rows.first[1:], strict=False)]
    np.testing.assert_allclose(point_rms(errors, obs), slow, rtol=1e-12)


def two_tracks_of_a_point():
    """Exact scene at its true motion; tracks 0 and 1 are of one point, and all others of other points."""
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)))
    obs, ids = observations(scene.tracks, CAMERA, 4)
    motion = motion_from_axis(scene.spin.axis, scene.spin.center, 0.5)
    truth = scene.point_of_track[ids]
    point = next(p for p in truth if (truth == p).sum() > 3)
    chosen = np.full(obs.points, -1)
    chosen[np.flatnonzero(truth == point)[[0, -1]]] = 0, 1
    chosen[truth != point] = 2 + np.arange((truth != point).sum())
    obs = obs.regroup(chosen)
    return OrbitSolution(motion, linear_points(motion, obs), 0.0, 0), obs


@pytest.mark.parametrize(("part", "merged"), [(0.9, True), (1.1, False)])
def test_points_merge_up_to_the_gate(part, merged):
    """Two estimates of a point that are `part` of the gate apart, by the covariance of 0.05 px in each coordinate."""
    solution, obs = two_tracks_of_a_point()
    options = ReidentificationOptions()
    H = normal_equations(solution.motion.Q, 0.5, solution.y, obs.rows, 2.0, 1).pp[:2]
    covariance = 0.05**2 * np.linalg.inv(H).sum(axis=0)
    off = np.linalg.cholesky(covariance) @ unit(0.3, -0.5, 0.8) * np.sqrt(part * options.chi2)
    y = solution.y.copy()
    y[:2] = y[0] + np.outer([-0.5, 0.5], off)
    label = merge_round(replace(solution, y=y), obs, np.arange(obs.points), options, 2.0)
    assert (label[0] == label[1]) == merged


def test_no_merged_point_leaves_a_track_far_off():
    """With a gate that lets every pair in, the test of the merged points alone keeps two points apart."""
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)), noise_px=0.3)
    obs, _ = observations(scene.tracks, CAMERA, 4)
    motion = motion_from_axis(scene.spin.axis, scene.spin.center, 0.5)
    start = OrbitSolution(motion, linear_points(motion, obs), 0.0, 0)
    options = ReidentificationOptions(chi2=1e12, rms_px=1.5)
    label = merge_round(start, obs, np.arange(obs.points), options, 2.0)
    assert np.array_equal(np.unique(label), np.arange(label.max() + 1))
    assert label.max() < obs.points - 1
    y = linear_points(motion, obs.regroup(label))
    errors = point_rms(row_errors(motion.Q, 0.5, y[label], obs.rows), obs)
    alone = np.bincount(label)[label] == 1
    assert errors[~alone].max() <= options.rms_px


@pytest.mark.parametrize("turns", [0.9, 1.6, 2.5])
def test_points_that_can_and_do_come_round_again_are_counted(turns):
    """At 0.5 Hz: the two numbers against a loop over points and their times."""
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)), duration_s=2 * turns)
    obs, ids = observations(scene.tracks, CAMERA, 4)
    obs = obs.regroup(np.unique(scene.point_of_track[ids], return_inverse=True)[1].astype(np.int64))
    begin, end = obs.rows.dt.min(), obs.rows.dt.max()
    able = again = 0
    for j in range(obs.points):
        dt = obs.of_point(j).dt
        able += bool(dt[0] + 2.0 <= end or dt[-1] - 2.0 >= begin)
        again += bool(dt[-1] - dt[0] >= 2.0 or (np.diff(dt) >= 1.0).any())
    assert reobservable_points(obs, 0.5) == able
    assert reobserved_points(obs, 0.5) == again
    assert (able > 0) == (turns > 1)


def test_pruning_drops_false_tracks_and_refuses_too_few_points():
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)), noise_px=0.3, outliers=0.2)
    obs, ids = observations(scene.tracks, CAMERA, 4)
    motion = motion_from_axis(scene.spin.axis, scene.spin.center, 0.5)
    whole = Landmarks(obs, bundle_adjustment(motion, linear_points(motion, obs), obs, 1.0), np.arange(obs.points))
    options = BackendOptions()
    found = prune(whole, options)
    true = scene.point_of_track[ids] >= 0
    kept = found.label >= 0
    assert kept[true].mean() > 0.95
    assert kept[~true].mean() < 0.5 * kept[true].mean()
    errors = row_errors(found.solution.motion.Q, found.solution.motion.rate_hz, found.solution.y, found.obs.rows)
    assert point_rms(errors, found.obs).max() < 1.1 * options.graph.prune_px
    few = replace(options, verdict=replace(options.verdict, min_points=obs.points))
    with pytest.raises(BackendError, match=f"{obs.points} are needed"):
        prune(whole, few)
