"""The rasteriser against a plain twin and against known light."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from esfo_core.camera import Camera
from esfo_core.errors import SimulationError
from esfo_core.orbit import rotation
from esfo_simulation.objects.hubble import hubble
from esfo_simulation.render.borders import blur_row
from esfo_simulation.render.exposure import blur_taps, develop, whole_steps
from esfo_simulation.render.rasterizer import PLANE, rasterize
from esfo_simulation.render.renderer import Light, Renderer, Window
from esfo_simulation.render.surface import Model
from esfo_simulation.render.tessellation import neighbours

AXIS, CENTER = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])


def slow_rasterize(corners, shape):
    """Ask every sample of every triangle."""
    ids, depth = np.zeros(shape, np.int32), np.zeros(shape)
    for m, ((ax, ay, za), (bx, by, zb), (cx, cy, zc)) in enumerate(corners.tolist()):
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area >= 0:
            continue
        for y, x in np.ndindex(*shape):
            sides = ((bx, by), (cx, cy)), ((cx, cy), (ax, ay)), ((ax, ay), (bx, by))
            weights = [(p[0] - x) * (q[1] - y) - (p[1] - y) * (q[0] - x) for p, q in sides]
            if max(weights) > 0:
                continue
            z = (weights[0] * za + weights[1] * zb + weights[2] * zc) / area
            if z > depth[y, x]:
                depth[y, x], ids[y, x] = z, m + 1
    return ids, depth


def rasterized(corners, shape):
    planes, ids, depth = np.zeros((len(corners) + 1, PLANE)), np.zeros(shape, np.int32), np.zeros(shape, np.float32)
    extent = np.tile(np.array([shape[1], -1]), (shape[0], 1))
    rasterize(np.pad(corners, ((0, 0), (0, 0), (0, 1))), planes, ids, depth, extent)
    return ids, depth, extent


def test_rasterizer_equals_its_twin():
    rng = np.random.default_rng(2)
    corners = np.concatenate([rng.uniform(-6, 30, (60, 3, 2)), rng.uniform(0.5, 2, (60, 3, 1))], axis=2)
    # Far larger than the grid, far smaller than a sample, and corners on samples.
    corners[:6, :, :2] = (corners[:6, :, :2] - 12) * 1e5
    corners[6:12, :, :2] = corners[6:12, :1, :2] + 0.05 * rng.random((6, 3, 2))
    corners[12:20, :, :2] = corners[12:20, :, :2].round()
    shape = (20, 24)
    ids, depth, extent = rasterized(corners, shape)
    expected, z = slow_rasterize(corners, shape)
    assert len(np.unique(ids)) > 15
    np.testing.assert_array_equal(ids, expected)
    # Single precision of 1/z, at most 2 here; its slope comes from differences of that precision.
    np.testing.assert_allclose(depth, z, atol=1e-6)
    for y in range(shape[0]):
        drawn = np.flatnonzero(ids[y])
        if len(drawn):
            assert extent[y].tolist() == [drawn[0], drawn[-1]]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_nothing_is_drawn_of_lines_points_and_what_is_no_number(bad):
    a, b, c = [2.0, 2, 1], [2.0, 9, 1], [9.0, 2, 1]
    corners = np.array([[a, a, b], [a, a, a], [a, c, b], [a, b, [9.0, bad, 1]], [[bad, 2, 1], b, c]])
    assert not rasterized(corners, (12, 12))[0].any()


def test_neighbours_of_a_mesh_share_an_edge_of_one_surface():
    # Corners in their own copies; the second sheet stands on an edge where two faces meet already.
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0], [1, 1, 0], [0.5, 0.5, 1.0]])
    faces = np.array([[0, 1, 2], [4, 5, 3], [4, 6, 5]], np.int32)
    np.testing.assert_array_equal(neighbours(Model(corners, faces[:2], np.ones(2))), [[-1, 1, -1], [-1, -1, 0]])
    assert (neighbours(Model(corners, faces, np.ones(3))) == -1).all()


def test_blur_equals_its_twin_and_keeps_the_light():
    rng = np.random.default_rng(4)
    taps = blur_taps(0.65)
    assert taps.sum() == pytest.approx(1, abs=1e-6)
    # Samples that hold means over half a pixel are blurred by those means already.
    offsets = (np.arange(len(taps)) - (len(taps) - 1) / 2) / 2
    assert taps @ offsets**2 + 0.5**2 / 12 == pytest.approx(0.65**2, rel=1e-4)
    rows = rng.random((2 * 5 + len(taps) - 2, 7)).astype(np.float32) + np.float32(0.1)
    fine, row = rng.random(2 * 9 + len(taps) - 2).astype(np.float32), np.empty(9, np.float32)
    blur_row(fine, taps, np.empty((2, len(fine) // 2), np.float32), row)
    # Single precision sums of so many positive terms.
    rtol = len(taps) * 2**-23
    np.testing.assert_allclose(row, [taps.astype(float) @ fine[2 * j : 2 * j + len(taps)] for j in range(9)], rtol=rtol)
    expected = np.log([taps.astype(float) @ rows[2 * i : 2 * i + len(taps)] for i in range(5)])
    steps, extent = np.empty((5, 7), np.uint16), np.tile(np.array([0, 6]), (len(rows), 1))
    develop(rows, extent, taps, (-3.0, 1e-4, np.float32(0.7)), steps)
    np.testing.assert_allclose(steps * 1e-4 - 3.0, expected, atol=0.5e-4 + 1e-6)
    assert (rows == np.float32(0.7)).all()
    assert (extent[:, 1] < 0).all()


def test_logarithm_is_right_to_a_millionth():
    radiance = np.geomspace(1e-3, 0.999, 60000).astype(np.float32)
    steps = np.empty(len(radiance), np.uint16)
    whole_steps(radiance, -7.0, 7.0 / 65535, np.empty(len(radiance), np.int32), steps)
    error = steps * (7.0 / 65535) - 7.0 - np.log(radiance.astype(float))
    assert np.abs(error).max() <= 0.5 * 7.0 / 65535 + 1e-6


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


def test_frames_do_not_depend_on_threads_or_on_those_before():
    camera = Camera(96, 80, np.array([[120.0, 0, 48], [0, 120, 40], [0, 0, 1]]), "plumb_bob", np.array([-0.3, 0, 0, 0]))
    renderers = [Renderer(hubble(1), camera, Window(4, 2, 88, 76), Light(), 0.65) for _ in range(2)]
    poses = [rotation(AXIS, 0.7 * k) for k in range(12)]

    def render(k):
        return renderers[0].render(poses[k], CENTER)

    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(render, range(12)))
    for k in reversed(range(12)):
        np.testing.assert_array_equal(together[k], renderers[1].render(poses[k], CENTER))


@pytest.mark.parametrize("blur", [0.0, 0.1, -1.0, np.nan])
def test_a_blur_that_samples_cannot_show_is_refused(blur):
    with pytest.raises(SimulationError, match=str(blur)):
        Renderer(square(0.0, 0.1, 0.8), Camera.pinhole(41, 41, 100.0), Window(4, 4, 33, 33), Light(), blur)
