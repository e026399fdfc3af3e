"""Lens distortion and the limits of the view: straight edges bend, nothing cracks, nothing is folded back."""

from __future__ import annotations

import numpy as np
import pytest
from test_edges import WORST_PX

from esfo_core.camera import Camera
from esfo_simulation.render.renderer import Light, Renderer, Window
from esfo_simulation.render.surface import Model
from esfo_simulation.render.tessellation import CHORD_ERROR_PX, field_of

FLAT = Light(direction=(0.0, 0.0, -1.0), ambient=1.0, diffuse=0.0)
K = np.array([[200.0, 0, 101], [0, 195, 79], [0, 0, 1]])
WINDOW, BLUR = Window(0, 0, 200, 160), 0.65
WIDE_K = np.array([[100.0, 0, 100.5], [0, 97.5, 79.5], [0, 0, 1]])
LENSES = {
    "barrel": Camera(200, 160, K, "plumb_bob", np.array([-0.35, 0.12, 1e-3, -2e-3, 0.0])),
    "pincushion": Camera(200, 160, K, "plumb_bob", np.array([0.3, 0.05, 0.0, 0.0, 0.0])),
    "rational": Camera(200, 160, K, "rational_polynomial", np.array([0.8, 0.2, 1e-3, 5e-4, 0.01, 1.1, 0.4, 0.03])),
    "fisheye": Camera(200, 160, WIDE_K, "equidistant", np.zeros(4)),
}


def share(model, camera, T=(0.0, 0.0, 0.0)):
    """How much of each pixel sees the model, whose albedo is 0.8."""
    renderer = Renderer(model, camera, WINDOW, FLAT, BLUR)
    radiance = np.exp(renderer.levels.log_radiance(renderer.render(np.eye(3), np.array(T))))
    return (radiance - FLAT.background) / (0.8 - FLAT.background)


def rectangle(low, high, z=1.0):
    corners = np.array([[low[0], low[1], z], [low[0], high[1], z], [high[0], high[1], z], [high[0], low[1], z]])
    return Model(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.full(2, 0.8))


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("y", [-0.33, -0.05, 0.27])
def test_a_straight_edge_bends_with_the_lens(name, y):
    camera = LENSES[name]
    image = share(rectangle((-3.0, y), (3.0, 30.0)), camera)
    line = camera.project(np.column_stack([np.linspace(-0.6, 0.6, 20001), np.full(20001, y), np.ones(20001)]))
    columns = np.arange(int(np.ceil(line[0, 0])), int(line[-1, 0]))
    columns = columns[(columns >= 5) & (columns < 195)]
    expected = np.interp(columns, line[:, 0], line[:, 1])
    slope = np.gradient(line[:, 1], line[:, 0])[np.searchsorted(line[:, 0], columns)]
    assert len(columns) > 100
    # light below the line, counted down the column; the blur keeps it
    found = expected.round().astype(int)[:, None] + np.arange(-6, 7)
    lit = image[found, columns[:, None]].sum(axis=1)
    error = (found[:, -1] + 0.5 - lit - expected) / np.hypot(1, slope)
    assert np.ptp(expected - np.interp(columns, columns[[0, -1]], expected[[0, -1]])) > 5 * CHORD_ERROR_PX
    # the chord, the border within its sample, and the blur of a line that bends: sigma^2 / 2 times its curvature
    bend = 0.5 * BLUR**2 * np.abs(np.gradient(np.gradient(line[:, 1], line[:, 0]), line[:, 0])[5:-5]).max()
    assert np.abs(error).max() < CHORD_ERROR_PX + WORST_PX + bend


@pytest.mark.parametrize("name", LENSES)
def test_a_wall_of_many_faces_has_no_cracks(name):
    """Faces of all sizes and shapes that fill the view, each edge shared by two."""
    rng = np.random.default_rng(6)
    grid = np.stack(np.meshgrid(np.arange(9.0), np.arange(7.0)), axis=-1) + rng.uniform(-0.3, 0.3, (7, 9, 2))
    xy = (grid - [4, 3]) * [0.8, 0.9]
    vertices = np.concatenate([xy, 1 + 0.3 * xy[..., :1] + 0.2 * rng.random((7, 9, 1))], axis=2).reshape(-1, 3)
    quads = np.array([[9 * i + j, 9 * i + j + 9, 9 * i + j + 10, 9 * i + j + 1] for i in range(6) for j in range(8)])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    image = share(Model(vertices, faces, np.full(len(faces), 0.8)), LENSES[name])
    np.testing.assert_allclose(image[20:140, 20:180], 1, atol=1e-4)


def test_what_the_lens_folds_back_is_not_seen():
    """r (1 - 0.5 r^2) grows up to r = 0.816, distorted 0.544, and comes back to the middle of the image at r = 1.41."""
    camera = Camera(200, 160, WIDE_K, "plumb_bob", np.array([-0.5, 0, 0, 0]))
    beyond = rectangle((1.0, -0.2), (1.3, 0.2))
    inside = camera.project(beyond.vertices)
    assert ((inside > [110, 20]) & (inside < [190, 140])).all()
    assert np.abs(share(beyond, camera)).max() < 1e-4
    image = share(rectangle((-9.0, -9.0), (9.0, 9.0)), camera)
    v, u = np.mgrid[:160, :200]
    radius = np.hypot((u - camera.K[0, 2]) / camera.K[0, 0], (v - camera.K[1, 2]) / camera.K[1, 1])
    rim = np.sqrt(2 / 3) * 2 / 3
    margin = 4 * BLUR / camera.K[1, 1]
    assert np.abs(image[radius > rim + margin]).max() < 1e-3
    np.testing.assert_allclose(image[radius < rim - margin], 1, atol=1e-3)


@pytest.mark.parametrize("name", LENSES)
def test_the_field_holds_all_that_the_sensor_sees(name):
    camera = LENSES[name]
    field = field_of(camera, np.array([0.0, 0.0]), np.array([199.0, 159.0]))
    v, u = np.mgrid[:160, :200]
    xy = camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1))
    assert (xy @ field.normals.T <= field.radius).all()
    # And little else: at most half as wide again as the farthest pixel is away.
    assert field.radius < 1.5 * np.linalg.norm(xy, axis=1).max()


def test_nothing_is_cut_or_halved_without_a_lens():
    assert np.isinf(field_of(Camera.pinhole(200, 160, 200.0), np.zeros(2), np.array([199.0, 159.0])).radius)


def test_a_floor_that_passes_under_the_camera_ends_at_the_horizon():
    """From 10 m behind to 1 km before the camera, 1 m below it."""
    corners = np.array([[-900, 1, -10], [-900, 1, 1000], [900, 1, 1000], [900, 1, -10.0]])
    for order in ([0, 2, 1], [0, 3, 2]), ([0, 3, 1], [1, 3, 2]):
        floor = Model(corners, np.array(order, np.int32), np.full(2, 0.8))
        camera = Camera.pinhole(200, 160, 150.0)
        image = share(floor, camera)
        horizon = camera.K[1, 2] + camera.focal_px / 1000
        np.testing.assert_allclose(image[:, 5:195].sum(axis=0), 159.5 - horizon, atol=WORST_PX)
        assert np.abs(image[: int(horizon) - 4]).max() < 1e-4


def test_a_body_behind_the_camera_or_beside_the_window_is_not_seen():
    for low, high, z in (((-1, -1), (1, 1), -1.0), ((5, 5), (9, 9), 1.0), ((-1, -1), (1, 1), 5e-4)):
        assert np.abs(share(rectangle(low, high, z), Camera.pinhole(200, 160, 200.0))).max() < 1e-4
