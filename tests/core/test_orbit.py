"""Geometry of the spin: two descriptions of one motion, the object frame and the image of the axis."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from esfo_core.camera import Camera
from esfo_core.errors import EsfoError
from esfo_core.orbit import OrbitError, PaperOrbit, Spin, angle_between, object_frame, rotation, tangent_basis

CAMERA = Camera.pinhole(640, 480, 800.0)
T0 = 1_700_000_000_123_456_789
CENTER = np.array([0.3, -0.2, 4.0])
RATE = 0.37


def unit(*v):
    return np.array(v, float) / np.linalg.norm(v)


def directions():
    """The 26 directions of a cube: along the camera's axes (orbits in vertical planes among them) and oblique."""
    steps = (-1, 0, 1)
    return [unit(x, y, z) for x in steps for y in steps for z in steps if (x, y, z) != (0, 0, 0)]


unit_vectors = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3).map(lambda v: unit(*v))


@settings(deadline=None)  # a busy machine is no failure
@given(unit_vectors, st.floats(-50, 50))
def test_rotation_is_that_of_scipy(axis, angle):
    R = rotation(axis, angle)
    np.testing.assert_allclose(R, Rotation.from_rotvec(angle * axis).as_matrix(), atol=1e-13)
    np.testing.assert_allclose(R @ axis, axis, atol=1e-14)


def test_rotation_is_right_handed():
    np.testing.assert_allclose(rotation(unit(0, 0, 1), np.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)


@pytest.mark.parametrize("axis", directions(), ids=str)
def test_spinning_object_and_orbiting_camera_see_the_same(axis):
    motion = Spin(axis, RATE, CENTER, T0)
    orbit = motion.paper_orbit()
    X = np.random.default_rng(1).normal(size=(20, 3))
    for seconds in (0.0, 0.1, 1.0, 1.9, 4.321):
        t = T0 + round(seconds * 1e9)
        expected = Rotation.from_rotvec(2 * np.pi * RATE * seconds * axis).apply(X) + CENTER
        R, translation = orbit.world_to_camera(seconds)
        np.testing.assert_allclose(motion.transform(X, t), expected, atol=1e-12)
        np.testing.assert_allclose(X @ R.T + translation, expected, atol=1e-12)
        np.testing.assert_allclose(R @ orbit.camera_center(seconds) + translation, 0, atol=1e-12)


@pytest.mark.parametrize("axis", directions(), ids=str)
def test_orbit_is_the_circle_of_equation_1(axis):
    orbit = Spin(axis, RATE, CENTER, T0).paper_orbit()
    np.testing.assert_allclose(orbit.normal, -axis)
    np.testing.assert_allclose([np.linalg.norm(orbit.u), orbit.u @ orbit.normal], [1, 0], atol=1e-15)
    np.testing.assert_allclose(orbit.radius, np.linalg.norm(np.cross(CENTER, axis)), rtol=1e-14)
    np.testing.assert_allclose(np.cross(orbit.c, axis), 0, atol=1e-15)  # the centre of the circle is on the axis
    v = np.cross(orbit.normal, orbit.u)
    for quarter, direction in enumerate((orbit.u, v, -orbit.u, -v)):
        expected = orbit.c + orbit.radius * direction
        np.testing.assert_allclose(orbit.camera_center(quarter / 4 / RATE), expected, atol=1e-14)
    np.testing.assert_allclose(orbit.camera_center(0.0), -CENTER, atol=1e-15)  # the camera sees the centre at CENTER
    np.testing.assert_allclose(orbit.R0 @ orbit.look_at(0.0), np.eye(3), atol=1e-15)
    assert orbit.rate_hz == RATE


@pytest.mark.parametrize("axis", directions(), ids=str)
def test_look_at_has_the_rows_right_down_forward(axis):
    orbit = Spin(axis, RATE, CENTER, T0).paper_orbit()
    for seconds in (0.0, 0.6, 2.0):
        L = orbit.look_at(seconds)
        right, down, forward = L
        np.testing.assert_allclose(L @ L.T, np.eye(3), atol=1e-14)
        np.testing.assert_allclose(np.cross(right, down), forward, atol=1e-14)
        np.testing.assert_allclose(down, -orbit.normal, atol=1e-14)  # the normal is up
        seen = L @ (orbit.c - orbit.camera_center(seconds))
        np.testing.assert_allclose(seen, [0, 0, orbit.radius], atol=1e-14)


def test_look_at_of_a_camera_worked_by_hand():
    # a camera at (2, 0, 0) that looks at the origin with z up sees -x forward, -z down and +y to its right
    orbit = PaperOrbit(2.0, 1.0, np.eye(3), unit(0, 0, 1), unit(1, 0, 0), np.zeros(3))
    np.testing.assert_allclose(orbit.look_at(0.0), [[0, 1, 0], [0, 0, -1], [-1, 0, 0]], atol=1e-15)
    R, translation = orbit.world_to_camera(0.0)
    np.testing.assert_allclose(R @ [0, 0, 0.5] + translation, [0, -0.5, 2], atol=1e-15)
    np.testing.assert_allclose(orbit.camera_center(0.25), [0, 2, 0], atol=1e-15)


def test_a_rate_times_a_year_keeps_its_phase():
    turns = 1e7
    t = T0 + round(turns * 4 * 1e9)
    assert float(Spin(unit(0, 1, 0), 0.25, CENTER, T0).angle(np.array([t]))[0]) == 2 * np.pi * turns


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("axis", [unit(0, 0, 1), unit(0.3, -0.2, 4.0), unit(1, 2, -3)], ids=str)
def test_an_axis_through_the_camera_has_no_orbit(axis, scale):
    with pytest.raises(OrbitError, match="passes through the camera centre"):
        Spin(axis, RATE, 3.7 * scale * axis, T0).paper_orbit()
    with pytest.raises(OrbitError):
        Spin(axis, RATE, np.zeros(3), T0).paper_orbit()
    beside = Spin(axis, RATE, scale * (3.7 * axis + 1e-9 * object_frame(axis)[:, 0]), T0)
    assert beside.paper_orbit().radius == pytest.approx(1e-9 * scale, rel=1e-5)
    assert issubclass(OrbitError, EsfoError)


@pytest.mark.parametrize("axis", directions(), ids=str)
def test_screw_line_lies_on_the_projected_axis(axis):
    motion = Spin(axis, RATE, CENTER, T0)
    pixels = motion.screw_line(CAMERA, 1.0)
    assert pixels.shape == (64, 2)
    line = np.linalg.inv(CAMERA.K).T @ np.cross(CENTER, axis)  # through the images of two points of the axis
    distance = np.c_[pixels, np.ones(64)] @ line / np.linalg.norm(line[:2])
    np.testing.assert_allclose(distance, 0, atol=1e-9)
    ends = np.array([CENTER - axis, CENTER + axis])
    np.testing.assert_allclose(pixels[[0, -1]], CAMERA.project(ends), atol=1e-9)


def test_screw_line_leaves_out_what_is_behind_the_camera():
    motion = Spin(unit(0.1, 0, 1), RATE, CENTER, T0)
    pixels = motion.screw_line(CAMERA, 20.0)
    assert 0 < len(pixels) < 64
    assert np.isfinite(pixels).all()
    depth = CENTER[2] + np.linspace(-20, 20, 64) * motion.axis[2]
    assert len(pixels) == np.count_nonzero(depth > 1e-3 * np.linalg.norm(CENTER))
    assert Spin(unit(1, 0, 0), RATE, -CENTER, T0).screw_line(CAMERA, 1.0).shape == (0, 2)


def test_screw_line_is_bent_by_the_lens():
    lens = Camera(640, 480, CAMERA.K, "plumb_bob", np.array([-0.3, 0.1, 0, 0]))
    motion = Spin(unit(1, 0, 0), RATE, np.array([0, 1.0, 4.0]), T0)
    pixels = motion.screw_line(lens, 1.5)
    assert np.ptp(pixels[:, 1]) > 1
    np.testing.assert_allclose(lens.unproject(pixels)[:, 1], 0.25, atol=1e-12)


@settings(deadline=None)  # a busy machine is no failure
@given(unit_vectors)
def test_object_frame_is_right_handed_with_z_along_the_axis(axis):
    R = object_frame(axis)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-14)
    assert np.linalg.det(R) > 0
    assert (R[:, 2] == axis).all()
    assert (tangent_basis(axis) == R[:, :2]).all()


def test_object_frame_takes_x_from_the_camera():
    np.testing.assert_allclose(object_frame(unit(0, 1, 0))[:, 0], [1, 0, 0])
    np.testing.assert_allclose(object_frame(unit(0, 1, 1))[:, 0], [1, 0, 0])
    np.testing.assert_allclose(object_frame(unit(1, 0, 0))[:, 0], [0, 1, 0])


@settings(deadline=None)  # a busy machine is no failure
@given(unit_vectors, st.floats(-9, 0).map(lambda e: 10**e))
def test_angle_between_is_exact_for_small_angles_too(axis, radians):
    turned = rotation(tangent_basis(axis)[:, 0], radians) @ axis
    assert angle_between(axis, 3 * turned) == pytest.approx(np.degrees(radians), rel=1e-6)
    assert angle_between(axis, -axis) == pytest.approx(180)
    assert angle_between(axis, axis) == 0
