"""Rendered images against cast rays and exact sub-pixel geometry: a second way to the same picture."""

from __future__ import annotations

import numpy as np
import pytest
from ray_casting import photograph

from esfo_core.camera import Camera
from esfo_core.orbit import rotation
from esfo_simulation.objects.hubble import hubble
from esfo_simulation.render.renderer import Light, Renderer, Window
from esfo_simulation.render.surface import Model, Mosaic, Surface

LIGHT = Light()
CAMERA, WINDOW = Camera.pinhole(60, 50, 100.0), Window(8, 5, 44, 40)
BARREL = Camera(
    96, 80, np.array([[120.0, 0, 48], [0, 118, 39], [0, 0, 1]]), "plumb_bob", np.array([-0.35, 0.12, 1e-3, -2e-3, 0])
)
FISHEYE = Camera(
    96, 80, np.array([[110.0, 0, 47], [0, 110, 40], [0, 0, 1]]), "equidistant", np.array([-0.02, 0.01, -4e-3, 1e-3])
)
WIDE = Camera(64, 48, np.array([[30.0, 0, 31], [0, 30, 24], [0, 0, 1]]), "equidistant", np.zeros(4))
TOWARDS_CAMERA = np.array([0.0, 0.0, -1.0])


def render(model, camera, window, blur, axis=TOWARDS_CAMERA, angle=0.0, center=(0.0, 0.0, 1.0)):
    renderer = Renderer(model, camera, window, LIGHT, blur)
    return np.exp(renderer.levels.log_radiance(renderer.render(rotation(axis, angle), np.array(center))))


def square(shift_px):
    """A square of 20 x 20 px that faces the camera at 1 m, shifted by (u, v) px from the optical axis."""
    corners = np.array([[-1, -1, 0], [-1, 1, 0], [1, 1, 0], [1, -1, 0.0]]) * 0.1
    corners[:, :2] += np.array(shift_px) / CAMERA.focal_px
    return Model(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.full(2, 0.9))


@pytest.mark.parametrize("shift_px", [(0.13, -0.07), (0.31, 0.17), (-5.4, 3.8)])
def test_a_square_lies_where_the_camera_projects_it(shift_px):
    image = render(square(shift_px), CAMERA, WINDOW, 0.65) - LIGHT.background
    v, u = np.mgrid[WINDOW.y : WINDOW.y + WINDOW.height, WINDOW.x : WINDOW.x + WINDOW.width]
    middle = np.array([(image * u).sum(), (image * v).sum()]) / image.sum()
    # either of two opposite edges is found to half a fine sample, a quarter of a pixel
    assert middle == pytest.approx(CAMERA.K[:2, 2] + shift_px, abs=0.25)


@pytest.mark.parametrize("blur", [0.5, 0.65, 0.9])
def test_an_edge_is_as_soft_as_the_blur(blur):
    moments = []
    for shift in (np.arange(16) + 0.5) / 16:
        across = np.diff(render(square((shift, 0.0)), CAMERA, WINDOW, blur)[20, 5:20])
        edge = CAMERA.K[0, 2] - 10 + shift
        u = WINDOW.x + 5.5 + np.arange(len(across)) - edge
        moments.append(np.array([across @ u, across @ (u * u)]) / across.sum())
    assert np.abs(np.array(moments)[:, 0]).max() <= 0.25 + 0.01
    mean, mean_square = np.mean(moments, axis=0)
    assert mean == pytest.approx(0, abs=0.02)
    # over all positions of the edge, the difference of neighbouring pixels adds a box of one pixel to the blur
    assert np.sqrt(mean_square - 1 / 12) == pytest.approx(blur, rel=0.02)


# Rays a sixth of a sample apart find an edge to 1/24 px, the renderer to 0.025 px where it runs along the grid (see
# test_edges.py); radiance then differs by contrast * error / (sigma sqrt(2 pi)).
EDGE_PX = 1 / 24 + 0.025


def compare(image, expected, blur, contrast):
    """Most pixels have at most one edge in reach; where several meet, as at corners, their errors may add up."""
    error = np.abs(image - expected)
    one_edge = contrast * EDGE_PX / (blur * np.sqrt(2 * np.pi))
    assert error.max() <= 3 * one_edge
    assert np.quantile(error, 0.99) <= one_edge
    assert np.abs(np.mean(image - expected)) <= 0.05 * one_edge


@pytest.mark.parametrize("angle", [0.4, 3.3])
@pytest.mark.parametrize(
    "camera", [Camera.pinhole(96, 80, 120.0), BARREL, FISHEYE], ids=["pinhole", "barrel", "fisheye"]
)
def test_the_satellite_looks_as_cast_rays_see_it(camera, angle):
    window, blur = Window(26, 18, 32, 32), 0.65
    axis = np.array([0.3, -0.7, -0.6]) / np.linalg.norm([0.3, -0.7, -0.6])
    model, center = hubble(2), np.array([0.004, -0.003, 0.6])
    image = render(model, camera, window, blur, axis, angle, center)
    expected = photograph(model.moved(rotation(axis, angle), center), camera, window, LIGHT, blur)
    assert (expected > 1.01 * LIGHT.background).mean() > 0.2
    compare(image, expected, blur, 1.0)


def room():
    """Floor, ceiling, side walls and back wall of checks, around the camera: all but the last pass by it."""
    surface = Surface(np.random.default_rng(3))
    x, y, z = np.eye(3)
    corner, size = np.array([-0.8, -0.6, -1.0]), np.array([1.7, 1.3, 3.0])
    checks = Mosaic(cells=(3, 4), base=0.5, palette=(0.1, 0.3, 0.9), raised=4e-3)
    surface.face(corner, size[2] * z, size[0] * x, checks)
    surface.face(corner + size[1] * y, size[0] * x, size[2] * z, checks)
    surface.face(corner, size[1] * y, size[2] * z, checks)
    surface.face(corner + size[0] * x, size[2] * z, size[1] * y, checks)
    surface.face(corner + size[2] * z, size[1] * y, size[0] * x, checks)
    return surface.build()


@pytest.mark.parametrize("camera", [Camera.pinhole(64, 48, 40.0), WIDE], ids=["pinhole", "wide"])
def test_walls_that_pass_by_the_camera_are_cut(camera):
    turn, window, blur = rotation(np.array([0.6, 0.8, 0.0]), 0.2), Window(0, 0, 64, 48), 0.65
    model = room()
    assert (model.vertices[:, 2] < 0).any()
    renderer = Renderer(model, camera, window, LIGHT, blur)
    image = np.exp(renderer.levels.log_radiance(renderer.render(turn, np.zeros(3))))
    expected = photograph(model.moved(turn, np.zeros(3)), camera, window, LIGHT, blur)
    compare(image, expected, blur, 0.9)
