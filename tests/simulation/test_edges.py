"""Where rendered edges lie: event times are interpolated from frames, so edges must move smoothly."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull
from scipy.special import ndtr

from esfo_core.camera import Camera
from esfo_core.orbit import rotation
from esfo_simulation.render.renderer import Light, Renderer, Window
from esfo_simulation.render.surface import Model

FLAT = Light(direction=(0.0, 0.0, -1.0), ambient=1.0, diffuse=0.0)
CAMERA, WINDOW, BLUR = Camera.pinhole(60, 60, 100.0), Window(0, 0, 60, 60), 0.65
SAMPLE = 0.5
# A border at the share a of a sample is seen as two, weighted 1 - a and a, with the right mean and a variance of
# a (1 - a) SAMPLE^2, of which SAMPLE^2 / 12 is allowed for in the blur. A variance that is off by V shifts the level of
# an edge at distance d from its middle by V d / (2 sigma^2); the third moment, at most SAMPLE^3 / (6 sqrt 3), by a
# sixth of it over sigma^2. Within half a pixel of the middle that is, in pixels:
VARIANCE = SAMPLE**2 * (1 / 4 - 1 / 12)
WORST_PX = VARIANCE * 0.5 / (2 * BLUR**2) + SAMPLE**3 / (36 * np.sqrt(3) * BLUR**2)


def share(model, window=WINDOW, camera=CAMERA, R=None, T=(0.0, 0.0, 0.0)):
    """How much of each pixel sees the model, whose albedo is 0.8."""
    renderer = Renderer(model, camera, window, FLAT, BLUR)
    radiance = np.exp(renderer.levels.log_radiance(renderer.render(np.eye(3) if R is None else R, np.array(T))))
    return (radiance - FLAT.background) / (0.8 - FLAT.background)


def mottled(mesh):
    """No two faces alike, so that borders inside are borders, too; but less than can be measured."""
    albedo = 0.8 * (1 - 1e-5 * np.random.default_rng(1).random(len(mesh.faces)))
    return Model(mesh.vertices.view(np.ndarray), mesh.faces.astype(np.int32), albedo)


def half_plane(angle, shift):
    """A square of 160 px that ends at n . (u, v) = shift px from the principal point, n at `angle`."""
    n, t = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    corners = np.array([shift * n + 80 * t, shift * n - 80 * t, (shift - 160) * n - 80 * t, (shift - 160) * n + 80 * t])
    vertices = np.column_stack([corners / CAMERA.focal_px, np.ones(4)])
    return Model(vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.full(2, 0.8))


@pytest.mark.parametrize("degrees", [0, 1, 7, 20, 44.9, 45, 45.1, 63, 89, 90, 135, 200, 271])
def test_an_edge_moves_smoothly(degrees):
    v, u = np.mgrid[:60, :60] - 29.5
    angle, errors = np.radians(degrees), []
    for shift in np.linspace(-0.5, 0.5, 11) + 0.013:
        inside = shift - np.cos(angle) * u - np.sin(angle) * v
        near = (np.abs(inside) < 0.5) & (np.hypot(u, v) < 24)
        slope = np.exp(-0.5 * (inside / BLUR) ** 2) / (BLUR * np.sqrt(2 * np.pi))
        errors.append((share(half_plane(angle, shift)) - ndtr(inside / BLUR))[near] / slope[near])
    error = np.concatenate(errors)
    assert np.abs(error).max() < WORST_PX
    assert np.sqrt(np.mean(error**2)) < WORST_PX / 2
    # no direction in which edges are drawn, which would make a body look larger or smaller
    assert abs(error.mean()) < 2e-3


@pytest.mark.parametrize(
    "mesh", [*(trimesh.creation.icosphere(n, 1.0) for n in (2, 4, 6)), trimesh.creation.box((1.2,) * 3)]
)
def test_a_body_is_as_large_as_its_outline(mesh):
    """Most triangles of the finest sphere are smaller than a sample: at its rim they are too narrow to be sampled."""
    rng = np.random.default_rng(1)
    model = Model(
        mesh.vertices.view(np.ndarray), mesh.faces.astype(np.int32), 0.8 * (1 - 1e-5 * rng.random(len(mesh.faces)))
    )
    camera, window = Camera.pinhole(80, 80, 120.0), Window(0, 0, 80, 80)
    for k in range(4):
        R, T = rotation(np.array([0.6, 0.8, 0.0]), 0.7 * k + 0.1), np.array([0.01 * k, 0.007 * k, 4.0])
        outline = ConvexHull(camera.project(mesh.vertices @ R.T + T))
        # `volume` of a plane figure is its area, `area` its circumference
        shift = (share(model, window, camera, R, T).sum() - outline.volume) / outline.area
        assert abs(shift) < SAMPLE / 100


def test_a_narrow_tube_keeps_its_width():
    """A boom of 12 long faces, 1.9 px wide: each is narrower than a sample."""
    mesh = trimesh.creation.cylinder(0.03, 1.6, sections=12)
    model = Model(
        mesh.vertices.view(np.ndarray), mesh.faces.astype(np.int32), 0.8 * (1 - 1e-5 * np.arange(len(mesh.faces)) / 48)
    )
    barrel = Camera(
        80, 80, np.array([[120.0, 0, 40], [0, 120, 40], [0, 0, 1]]), "plumb_bob", np.array([-0.4, 0.1, 0, 0])
    )
    for k in range(5):
        R = rotation(np.array([0.8, 0.0, 0.6]), 0.6 * k + 0.2) @ rotation(np.array([1.0, 0, 0]), 1.3)
        for camera in (Camera.pinhole(80, 80, 120.0), barrel):
            T = np.array([0.0, 0.0, 3.8])
            outline = ConvexHull(camera.project(mesh.vertices @ R.T + T))
            assert abs((share(model, Window(0, 0, 80, 80), camera, R, T).sum() - outline.volume) / outline.area) < 0.02
