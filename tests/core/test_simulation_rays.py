"""Rendered images against cast rays and exact sub-pixel geometry: a second way to the same picture."""

from __future__ import annotations

import numpy as np
import pytest

from esfo_core.camera import Camera
from esfo_core.orbit import rotation
from esfo_core.simulation.renderer import Light, Renderer, Window
from esfo_core.simulation.objects.hubble import hubble
from esfo_core.simulation.surface import Model

LIGHT = Light()
CAMERA, WINDOW = Camera.pinhole(60, 50, 100.0), Window(8, 5, 44, 40)
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


def cast(model, directions):
    """Nearest face that each ray (N, 3) from the origin hits from the front, -1 for none (Moeller, Trumbore 1997)."""
    a, b, c = (model.vertices[model.faces[:, k]] for k in range(3))
    e1, e2, q = b - a, c - a, np.cross(-a, b - a)
    found = np.full(len(directions), -1)
    for n, d in enumerate(directions):
        p = np.cross(d, e2)
        with np.errstate(divide="ignore", invalid="ignore"):
            det = np.einsum("ij,ij->i", e1, p)
            u, v = np.einsum("ij,ij->i", -a, p) / det, q @ d / det
            t = np.einsum("ij,ij->i", e2, q) / det
        hit = (det > 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        if hit.any():
            found[n] = np.flatnonzero(hit)[np.argmin(t[hit])]
    return found


@pytest.mark.parametrize("angle", [0.4, 3.3])
def test_the_satellite_looks_as_cast_rays_see_it(angle):
    camera, window, blur = Camera.pinhole(96, 80, 120.0), Window(12, 4, 72, 72), 0.2
    axis = np.array([0.3, -0.7, -0.6]) / np.linalg.norm([0.3, -0.7, -0.6])
    model, center = hubble(2), np.array([0.004, -0.003, 0.8])
    image = render(model, camera, window, blur, axis, angle, center)
    turned = model.moved(rotation(axis, angle), center)
    # a pixel is the mean of its 2 x 2 samples, so small a blur leaves all but the part `leak` to them
    samples = np.array([-0.25, 0.25])
    v, u, dv, du = np.meshgrid(
        window.y + np.arange(2, 70, 2), window.x + np.arange(2, 70, 2), samples, samples, indexing="ij"
    )
    uv = np.stack([u + du, v + dv], axis=-1).reshape(-1, 2)
    face = cast(turned, np.column_stack([camera.unproject(uv), np.ones(len(uv))]))
    assert 0.1 < (face >= 0).mean() < 0.8
    facing = np.maximum(turned.normals() @ np.array(LIGHT.direction), 0)
    shade = np.append(turned.albedo * (LIGHT.ambient + LIGHT.diffuse * facing), LIGHT.background)
    expected = shade[face].reshape(-1, 4).mean(axis=1)
    weights = np.exp(-0.5 * (np.array([0.25, 0.75]) / blur) ** 2)
    leak = 1 - (weights[0] / weights.sum()) ** 2
    error = np.abs(image[2:70:2, 2:70:2].ravel() - expected)
    # but for samples that lie on an edge to the last digit
    assert (error <= leak + 1e-3).mean() > 0.999
