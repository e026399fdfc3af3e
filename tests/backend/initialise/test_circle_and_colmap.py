"""COLMAP's start: cameras from tracks, circle, phase slope."""

import numpy as np
import pytest
from scenes import CAMERA, spin, tracks_of, unit

from esfo_backend.errors import BackendError
from esfo_backend.initialise.circle import fit_circle, orbit_of_cameras
from esfo_backend.initialise.colmap import bounded, cut_views, run_colmap
from esfo_backend.options import InitialisationOptions
from esfo_core.orbit import angle_between


@pytest.mark.parametrize("normal", [unit(0, 0, 1), unit(1, 0, 0), unit(0, 1, 0), unit(1, -2, 0.5)])
def test_circle_in_any_plane(normal):
    e1 = np.cross(normal, unit(0.3, 0.5, 0.9))
    e1 /= np.linalg.norm(e1)
    angle = np.linspace(0, 4, 30)[:, None]
    points = np.array([1.0, 2, 3]) + 2.5 * (np.cos(angle) * e1 + np.sin(angle) * np.cross(normal, e1))
    circle = fit_circle(points)
    assert circle.radius == pytest.approx(2.5, rel=1e-9)
    np.testing.assert_allclose(circle.center, [1, 2, 3], atol=1e-9)
    assert abs(circle.normal @ normal) == pytest.approx(1, abs=1e-12)
    assert circle.rms < 1e-9


def test_points_on_a_line_are_no_circle():
    with pytest.raises(BackendError, match="line"):
        fit_circle(np.outer(np.arange(5.0), [1, 2, 3]))


ALL_ROUND = [unit(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)]
"""Orbits in vertical planes among them, for which z = ax + by has no answer."""


@pytest.mark.parametrize("axis", ALL_ROUND, ids=str)
def test_orbit_of_exact_cameras(axis):
    truth = spin(axis)
    orbit = truth.paper_orbit()
    seconds = np.linspace(0, 3, 60)
    poses = [orbit.world_to_camera(t) for t in seconds]
    found = orbit_of_cameras(np.array([p[0] for p in poses]), np.array([p[1] for p in poses]), seconds)
    assert angle_between(found.motion.axis, axis) < 1e-6
    assert found.motion.rate_hz == pytest.approx(0.5, rel=1e-9)
    assert found.turns == pytest.approx(1.5, rel=1e-9)
    assert found.circle_residual < 1e-9


def test_views_hold_each_track_once():
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)), window_s=0.01)
    views = cut_views(scene.tracks, CAMERA, 0.03)
    assert len(views.seconds) == pytest.approx(4 / 0.03, abs=2)
    for track, uv in zip(views.track, views.uv, strict=True):
        assert len(np.unique(track)) == len(track) == len(uv)


def test_what_colmap_gets_is_bounded():
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)), points=100)
    views = cut_views(scene.tracks, CAMERA, 0.03)
    same = bounded(views, InitialisationOptions(colmap_max_views=len(views.track)))
    assert all(np.array_equal(a, b) for a, b in zip(same.track + same.uv, views.track + views.uv, strict=True))
    assert np.array_equal(same.seconds, views.seconds)
    few = bounded(views, InitialisationOptions(colmap_max_views=20, colmap_max_tracks=10))
    assert len(few.track) == len(few.uv) == len(few.seconds) == 20
    begin = int(np.flatnonzero(views.seconds == few.seconds[0])[0])
    for k, (track, uv) in enumerate(zip(few.track, few.uv, strict=True)):
        whole = views.track[begin + k]
        kept = np.isin(whole, track)
        assert len(track) == kept.sum() == min(10, len(whole))
        assert np.array_equal(track, whole[kept])
        assert np.array_equal(uv, views.uv[begin + k][kept])
        lengths = np.array([sum(i in t for t in views.track[begin : begin + 20]) for i in whole])
        assert lengths[kept].min() >= lengths[~kept].max(initial=0)


@pytest.fixture(scope="module")
def rich_scene():
    """About 25 tracks per window that last 0.3 s, with 0.5 px of noise."""
    return tracks_of(spin(unit(0.3, -0.8, 0.4)), points=150, noise_px=0.5)


def test_colmap_end_to_end_on_rich_tracks(rich_scene):
    views = cut_views(rich_scene.tracks, CAMERA, 0.03)
    assert 20 < np.mean([len(t) for t in views.track]) < 30
    start = run_colmap(rich_scene.tracks, CAMERA, InitialisationOptions())
    assert start.registered > 0.9 * start.views
    assert start.rms_px < 1.0
    assert start.orbit.circle_residual < 0.05
    assert start.orbit.motion.rate_hz == pytest.approx(0.5, rel=0.01)
    assert angle_between(start.orbit.motion.axis, rich_scene.spin.axis) < 1.0


def test_colmap_gives_the_same_bits_twice():
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)), points=100, noise_px=0.5, duration_s=1.0)
    a, b = (run_colmap(scene.tracks, CAMERA, InitialisationOptions()) for _ in range(2))
    assert a.orbit.motion.Q.tobytes() == b.orbit.motion.Q.tobytes()
    assert a.registered == b.registered


def test_sparse_tracks_are_refused_by_name():
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)), points=15)
    with pytest.raises(BackendError, match="too few for COLMAP"):
        run_colmap(scene.tracks, CAMERA, InitialisationOptions())
