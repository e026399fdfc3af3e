"""Tracks of one point are merged, tracks of two points are not."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import CAMERA, spin, tracks_of, unit

from esfo_backend.adjustment.bundle_adjustment import bundle_adjustment, linear_points
from esfo_backend.landmarks.landmarks import Landmarks, drop_far
from esfo_backend.landmarks.reidentification import merge_round, point_rms, reidentify
from esfo_backend.options import ReidentificationOptions
from esfo_backend.orbit.observations import observations
from esfo_backend.orbit.parametrization import motion_from_axis


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
