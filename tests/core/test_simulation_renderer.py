"""The rasteriser against a plain twin and against known light."""

import numpy as np
import pytest

from esfo_core.camera import Camera
from esfo_core.orbit import rotation
from esfo_core.simulation.renderer import Light, Renderer, Window, quantize, rasterize, reduce_columns, reduce_rows
from esfo_core.simulation.objects.hubble import hubble
from esfo_core.simulation.surface import Model

AXIS, CENTER = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])


def slow_rasterize(uv, inverse_depth, faces, shade, image, depth):
    """Ask every pixel of every face; the sums are those of the kernel, so the results are the same to the bit."""
    for face, radiance in zip(faces, shade, strict=True):
        a, b, c = uv[face].tolist()
        za, zb, zc = inverse_depth[face].tolist()
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area >= 0:
            continue
        for y, x in np.ndindex(*image.shape):
            weights = [(p[0] - x) * (q[1] - y) - (p[1] - y) * (q[0] - x) for p, q in ((b, c), (c, a), (a, b))]
            if max(weights) > 0:
                continue
            z = (weights[0] * za + weights[1] * zb + weights[2] * zc) / area
            if z > depth[y, x]:
                depth[y, x], image[y, x] = z, radiance


def test_rasterizer_equals_its_twin():
    rng = np.random.default_rng(2)
    uv = rng.uniform(-6, 30, (60, 2))
    faces = rng.integers(0, 60, (40, 3)).astype(np.int32)
    inverse_depth, shade = rng.uniform(0.5, 2, 60), rng.random(40).astype(np.float32)
    images, depths = np.zeros((2, 20, 24), np.float32), np.zeros((2, 20, 24))
    rasterize(uv, inverse_depth, faces, shade, images[0], depths[0])
    slow_rasterize(uv, inverse_depth, faces, shade, images[1], depths[1])
    assert (images[1] > 0).sum() > 200
    np.testing.assert_array_equal(images[0], images[1])
    np.testing.assert_array_equal(depths[0], depths[1])


def test_blur_and_quantisation_equal_their_twins():
    rng = np.random.default_rng(4)
    fine, taps = rng.random((18, 22)).astype(np.float32) + np.float32(0.1), rng.random(6).astype(np.float32)
    rows, columns = np.empty((7, 22), np.float32), np.empty((18, 9), np.float32)
    reduce_rows(fine, taps, rows)
    reduce_columns(fine, taps, columns)
    # float32 sums of six positive terms: relative rounding of at most six units in the last place.
    by_row = np.array([taps.astype(float) @ fine[2 * i : 2 * i + 6].astype(float) for i in range(7)])
    by_column = np.array([fine[:, 2 * j : 2 * j + 6].astype(float) @ taps.astype(float) for j in range(9)]).T
    np.testing.assert_allclose(rows, by_row, rtol=6 * 2**-23)
    np.testing.assert_allclose(columns, by_column, rtol=6 * 2**-23)
    steps = np.empty(fine.shape, np.uint16)
    quantize(fine, -3.0, 1e-4, steps)
    # Half a step, and the rounding of the logarithm of a float32.
    np.testing.assert_allclose(steps * 1e-4 - 3.0, np.log(fine.astype(float)), atol=0.5e-4 + 1e-6)


def square(depth_m, half_m, albedo):
    corners = np.array([[-1, -1, 0], [-1, 1, 0], [1, 1, 0], [1, -1, 0.0]]) * half_m + [0, 0, depth_m]
    return Model(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.full(2, albedo))


def test_a_square_has_its_place_size_and_radiance():
    camera, light = Camera.pinhole(41, 41, 100.0), Light(direction=(0.0, 0.0, -1.0))
    renderer = Renderer(square(0.0, 0.1, 0.8), camera, Window(4, 4, 33, 33), light, 0.65)
    image = np.exp(renderer.levels.log_radiance(renderer.render(np.eye(3), CENTER)))
    lit = 0.8 * (light.ambient + light.diffuse)
    assert image[16, 16] == pytest.approx(lit, rel=renderer.levels.step)
    assert image[0, 0] == pytest.approx(light.background, rel=renderer.levels.step)
    # The square ends half-way between fine samples and blur keeps the light: 20 x 20 px, centred on pixel (20, 20).
    share = (image - light.background) / (lit - light.background)
    assert share.sum() == pytest.approx(400, rel=1e-3)
    rows, columns = np.mgrid[:33, :33]
    assert (share * columns).sum() / share.sum() + 4 == pytest.approx(20, abs=1e-2)
    assert (share * rows).sum() / share.sum() + 4 == pytest.approx(20, abs=1e-2)
    np.testing.assert_allclose(image, image.T, rtol=1e-3)


def test_what_is_nearer_hides_and_backs_are_not_seen():
    camera = Camera.pinhole(41, 41, 100.0)
    near, far = square(-0.1, 0.05, 0.9), square(0.1, 0.1, 0.2)
    both = Model(
        np.vstack([far.vertices, near.vertices]), np.vstack([far.faces, near.faces + 4]), np.repeat([0.2, 0.9], 2)
    )
    renderer = Renderer(both, camera, Window(4, 4, 33, 33), Light(direction=(0.0, 0.0, -1.0)), 0.65)
    image = np.exp(renderer.levels.log_radiance(renderer.render(np.eye(3), CENTER)))
    assert image[16, 16] == pytest.approx(0.9, rel=1e-3)
    # 7 px from the centre: 1.4 px (2.2 sigma) outside the near square, so 1.5 % of its 0.7 excess leaks in, 0.01.
    assert image[16, 9] == pytest.approx(0.2, abs=0.012)
    turned = np.exp(renderer.levels.log_radiance(renderer.render(rotation(AXIS, np.pi), CENTER)))
    np.testing.assert_allclose(turned, 0.22, rtol=1e-3)


def test_satellite_has_many_contrasts_and_no_symmetry():
    model = hubble(1)
    assert len(np.unique(model.vertices.round(6), axis=0)) > 500
    assert (model.albedo > 0).all()
    assert (model.albedo <= 1).all()
    assert np.isfinite(model.normals()).all()
    # Half a turn about the tube must not bring it near itself: some vertex is alone by more than 2 cm.
    half = model.vertices * [-1, -1, 1]
    distance = np.linalg.norm(half[:, None] - model.vertices[None], axis=2).min(axis=1)
    assert distance.max() > 0.02
    np.testing.assert_array_equal(hubble(1).vertices, model.vertices)
    assert not np.array_equal(hubble(2).vertices, model.vertices)
