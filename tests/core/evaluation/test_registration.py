"""Points of a surface are laid on it again, whatever their scale and phase; others are not."""

import numpy as np
import pytest
import trimesh

from esfo_core.evaluation.registration import MeshSurface, RegistrationError, register
from esfo_core.orbit import Spin, object_frame, rotation
from esfo_simulation.objects.catalogue import OBJECTS

AXIS = np.array([0.3, -0.8, 0.4]) / np.linalg.norm([0.3, -0.8, 0.4])
TRUE = Spin(AXIS, 0.5, np.array([0.1, 0.05, 4.0]), 0)


@pytest.fixture(scope="module")
def mesh():
    return OBJECTS["hubble"](1).moved(object_frame(AXIS), np.zeros(3)).to_trimesh()


@pytest.fixture(scope="module")
def surface(mesh):
    return MeshSurface(mesh)


def estimated(mesh, phase=0.0, noise=0.0, count=200, tilt=0.0):
    """Points of the surface in the coordinates of an estimate whose orbit has the radius 1, and its spin."""
    samples = np.asarray(trimesh.sample.sample_surface(mesh, count, seed=5)[0])
    samples = samples + np.random.default_rng(2).normal(0, noise, samples.shape)
    unit = 1 / np.linalg.norm(np.cross(TRUE.center, AXIS))
    turn = rotation(np.array([0.0, 0, 1]), tilt) @ rotation(AXIS, phase)
    axis = turn @ AXIS
    along = 0.2 * axis  # the place along the axis is a convention
    return (samples @ turn.T) * unit - along, Spin(axis, 0.5, TRUE.center * unit + along, 0)


def test_nearest_is_that_of_all_faces(mesh, surface):
    points = np.random.default_rng(1).uniform(mesh.bounds[0], mesh.bounds[1], (20, 3))
    triangles = np.asarray(mesh.triangles)
    for point, found in zip(points, surface.nearest(points), strict=True):
        every = trimesh.triangles.closest_point(triangles, np.repeat(point[None], len(triangles), axis=0))
        slow = np.linalg.norm(every - point, axis=1).min()
        assert np.linalg.norm(found - point) == pytest.approx(slow, abs=2e-3 * surface.diameter)


@pytest.mark.parametrize("phase", [0.0, 1.0, -2.3])
@pytest.mark.parametrize("tilt", [0.0, 0.02])
def test_exact_points_are_laid_on_the_surface(mesh, surface, phase, tilt):
    points, spin = estimated(mesh, phase, tilt=tilt)
    found = register(points, spin, surface, TRUE)
    assert found.mean_percent < 0.05
    scale = np.cbrt(np.linalg.det(found.T[:3, :3]))
    assert scale == pytest.approx(np.linalg.norm(np.cross(TRUE.center, AXIS)), rel=0.01)


def test_noise_comes_out_as_it_went_in(mesh, surface):
    noise = 0.01 * surface.diameter
    points, spin = estimated(mesh, 0.5, noise, 600)
    found = register(points, spin, surface, TRUE)
    # The distance from a plane is normal with this deviation, its mean 0.8 of it; a thin part has two sides.
    assert 0.4 < found.mean_percent < 0.85
    assert found.median_percent < found.mean_percent


def test_points_of_another_object_stay_away(mesh, surface):
    ball = np.random.default_rng(0).normal(size=(200, 3))
    ball *= 0.4 * surface.diameter / np.linalg.norm(ball, axis=1)[:, None]
    found = register(ball, TRUE, surface, TRUE)
    assert found.mean_percent > 1.0  # the registration shrinks a ball into the body, but lays it on no surface


def test_too_few_points_are_refused(surface):
    with pytest.raises(RegistrationError, match="3 points"):
        register(np.zeros((3, 3)), TRUE, surface, TRUE)
