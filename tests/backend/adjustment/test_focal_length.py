"""A lens that is a quarter longer than assumed: found where the orbit shows it, and allowed for where it does not."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scenes import CAMERA, NONE_ENDED, spin, tracks_of, unit

from esfo_backend.adjustment.bundle_adjustment import bundle_adjustment, linear_points
from esfo_backend.adjustment.covariance import motion_covariance, schur_marginal
from esfo_backend.adjustment.focal_length import estimate_focal, with_focal
from esfo_backend.backend import Backend
from esfo_backend.options import BackendOptions, InitialisationOptions
from esfo_backend.orbit.observations import observations
from esfo_backend.orbit.parametrization import motion_from_axis
from esfo_core.camera import Camera
from esfo_core.orbit import tangent_basis
from esfo_core.tracks import TrackUpdate
from esfo_simulation.activity import synthetic_activity

AXIS = unit(0.3, -0.8, 0.4)
TRUE_PX = 800.0
ASSUMED = replace(Camera.pinhole(640, 480, TRUE_PX / 1.25), focal_std=0.4)
DIRECT = BackendOptions(initialisation=InitialisationOptions(method="direct"))


def optimum(camera, radius=0.35, seed=0, noise_px=0.3):
    scene = tracks_of(spin(AXIS), noise_px=noise_px, points=80, object_radius=radius, track_s=1.0, seed=seed)
    obs, ids = observations(scene.tracks, camera, 4)
    obs = obs.regroup(np.unique(scene.point_of_track[ids], return_inverse=True)[1].astype(np.int64))
    start = motion_from_axis(AXIS, scene.spin.center, 0.5)
    return bundle_adjustment(start, linear_points(start, obs), obs, 1.0), obs


def test_exact_tracks_give_the_exact_focal_length():
    found = estimate_focal(*optimum(ASSUMED, noise_px=0.0), ASSUMED, 1.0, 0.0)
    assert found.camera.focal_px == pytest.approx(TRUE_PX, rel=1e-3)
    assert found.solution.motion.axis @ AXIS > np.cos(1e-3)


def test_pixels_stay_where_they_are():
    _, obs = optimum(ASSUMED)
    moved = with_focal(obs, 1.25)
    np.testing.assert_allclose(moved.rows.xy * moved.rows.focal, obs.rows.xy * obs.rows.focal)


@pytest.mark.parametrize("factor", [0.7, 1.25, 1.6])
def test_where_perspective_shows_it_the_lens_is_found(factor):
    pulls = []
    for seed in range(6):
        assumed = replace(Camera.pinhole(640, 480, TRUE_PX / factor), focal_std=0.4)
        camera = estimate_focal(*optimum(assumed, seed=seed), assumed, 1.0, 0.0).camera
        assert camera.focal_std < 0.1
        pulls.append(np.log(camera.focal_px / TRUE_PX) / camera.focal_std)
    assert max(np.abs(pulls)) < 3


def test_where_nothing_shows_it_the_prior_stays():
    found = estimate_focal(*optimum(ASSUMED, radius=0.02), ASSUMED, 1.0, 0.25).camera
    assert found.focal_std > 0.3
    assert abs(np.log(found.focal_px / TRUE_PX)) < 3 * found.focal_std


def solved(camera, radius, seed):
    scene = tracks_of(spin(AXIS), noise_px=0.3, points=100, object_radius=radius, seed=seed)
    backend = Backend(camera, DIRECT)
    backend.add(TrackUpdate(scene.tracks, NONE_ENDED), synthetic_activity(scene.spin, scene.points, CAMERA, 4.0))
    return backend.solve()


@pytest.mark.parametrize("radius", [0.35, 0.05])
def test_the_axis_allows_for_what_is_not_known_of_the_lens(radius):
    """Also where the error of an axis that trusts the assumed lens is many of its deviations."""
    for seed in range(3):
        estimate = solved(ASSUMED, radius, seed)
        assert estimate.spin is not None, estimate.reason
        axis = estimate.spin.axis if estimate.spin.axis @ AXIS > 0 else -estimate.spin.axis
        off = tangent_basis(axis).T @ AXIS
        assert np.sqrt(off @ np.linalg.solve(estimate.axis_cov, off)) < 3
        assert abs(estimate.focal_px - TRUE_PX) < 3 * estimate.focal_std_px
        assert abs(estimate.spin.rate_hz - 0.5) < 3 * estimate.rate_std_hz


def test_a_calibrated_camera_keeps_its_focal_length():
    estimate = solved(CAMERA, 0.35, 0)
    assert np.isnan(estimate.focal_px)
    content = json.loads(json.dumps(estimate.to_json({})))
    assert content["focal_px"] is content["focal_std_px"] is None


def test_the_focal_length_goes_on_in_incremental_estimates_and_in_a_state(tmp_path):
    scene = tracks_of(spin(AXIS), noise_px=0.3, points=100, duration_s=6.0)
    activity = synthetic_activity(scene.spin, scene.points, CAMERA, 6.0)
    backend = Backend(ASSUMED, DIRECT)
    backend.add(TrackUpdate(scene.tracks, NONE_ENDED), activity)
    first = backend.solve(thorough=False)
    backend.save(tmp_path / "state.npz")
    for other in (backend, Backend.load(tmp_path / "state.npz", DIRECT)):
        after = other.solve(thorough=False)
        assert after.focal_px == pytest.approx(first.focal_px)
        assert after.focal_std_px == pytest.approx(first.focal_std_px)


def test_the_covariance_of_the_axis_contains_what_another_lens_does_to_it():
    """Against the axis of the same pixels behind a lens 2 % longer and shorter."""
    solution, obs = optimum(CAMERA)
    marginal, basis = schur_marginal(solution, obs, 1.0), tangent_basis(solution.motion.axis)
    step, axes = 0.02, []
    for s in (-step, step):
        moved = with_focal(obs, float(np.exp(s)))
        axes.append(bundle_adjustment(solution.motion, linear_points(solution.motion, moved), moved, 1.0).motion.axis)
    shift = basis.T @ (axes[1] - axes[0]) / (2 * step)
    known, open_ = (motion_covariance(solution, obs, marginal, 1.0, 0.0, std).axis_cov for std in (0.0, 0.3))
    expected = 0.3**2 * np.outer(shift, shift)
    np.testing.assert_allclose(open_ - known, expected, rtol=0.1, atol=0.1 * np.abs(expected).max())
