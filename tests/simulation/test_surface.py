"""Surfaces: closed bodies of known volume, patterns that stay where they belong."""

from __future__ import annotations

import numpy as np
import pytest

from esfo_simulation.render.surface import Mosaic, Surface, circle, facing, plain, rectangle, rounded


def surface():
    return Surface(np.random.default_rng(3))


def closed(part):
    """The mesh with its equal vertices joined, which must be closed."""
    mesh = part.build().to_trimesh()
    mesh.merge_vertices()
    assert mesh.is_watertight
    return mesh


def polygon_area(outline):
    x, y = outline.T
    return 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))


def test_facing_is_a_rotation_that_takes_z_to_the_direction():
    for normal in np.vstack([np.random.default_rng(1).standard_normal((20, 3)), np.eye(3), -np.eye(3)]):
        R = facing(normal)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(R) == pytest.approx(1)
        np.testing.assert_allclose(R[:, 2], normal / np.linalg.norm(normal), atol=1e-15)
        if abs(R[2, 2]) < 1 - 1e-9:
            assert R[2, 1] > 0  # y goes upwards
            assert R[2, 0] == pytest.approx(0, abs=1e-15)


def test_outlines_turn_counter_clockwise_around_their_area():
    assert polygon_area(rectangle(0.4, 0.3, (5, 6))) == pytest.approx(0.12)
    assert polygon_area(circle(0.5, 6, (1, 2))) == pytest.approx(6 * 0.5 * 0.25 * np.sin(np.pi / 3))
    # round corners cut (1 - pi / 4) r^2 each
    cut = (1 - np.pi / 4) * sum(r * r for r in (0.02, 0.05, 0.01, 0.08))
    outline = rounded(0.4, 0.3, [0.02, 0.05, 0.01, 0.08], 200, (-3, 2))
    assert polygon_area(outline) == pytest.approx(0.12 - cut, rel=1e-5)
    np.testing.assert_allclose((outline.min(axis=0) + outline.max(axis=0)) / 2, [-3, 2])
    # the largest radius is that of the upper left corner
    assert np.linalg.norm(outline - [-3.2, 2.15], axis=1).min() == pytest.approx((np.sqrt(2) - 1) * 0.08, rel=1e-3)


def test_bodies_are_closed_and_have_their_volume():
    part = surface()
    part.revolve([(0.3, -0.1), (0.3, 0.4)], 12, [plain(0.5)])
    assert closed(part).volume == pytest.approx(0.5 * polygon_area(circle(0.3, 12)))
    cone = surface()
    cone.revolve([(0.3, 0.0), (0.0, 0.9)], 12, [plain(0.5)])
    assert closed(cone).volume == pytest.approx(0.3 * polygon_area(circle(0.3, 12)))
    bowl = surface()
    bowl.revolve([(0.0, 0.0), (0.3, 0.3), (0.0, 0.1)], 12, [plain(0.5), plain(0.6)])
    assert closed(bowl).volume == pytest.approx(0.1 / 3 * polygon_area(circle(0.3, 12)))
    block = surface()
    block.extrude(rounded(0.4, 0.3, [0.05] * 4), -1, 1, [plain(0.5)])
    assert closed(block).volume == pytest.approx(2 * polygon_area(rounded(0.4, 0.3, [0.05] * 4)))
    rod = surface()
    rod.rod([1, 2, 3], [1.1, 2.2, 2.8], 0.01, 0.5)
    assert closed(rod).volume == pytest.approx(0.3 * polygon_area(circle(0.01, 6)))
    np.testing.assert_allclose(closed(rod).center_mass, [1.05, 2.1, 2.9])
    box = surface()
    box.box([1, 2, 3], facing([1, 2, 3]) * 0.1, plain(0.5))
    assert closed(box).volume == pytest.approx(0.2**3)


def test_parts_have_coordinates_of_their_own():
    whole = surface()
    R = facing([1, 0, 0])
    whole.placed([1, 2, 3], R).placed([0, 0, 0.5], R).polygon(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]), 0.5)
    expected = np.array([1.5, 2, 3]) + np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) @ (R @ R).T
    np.testing.assert_allclose(whole.build().vertices, expected, atol=1e-15)


def test_patches_lie_apart_over_their_face_and_look_the_same_way():
    mosaic = Mosaic((4, 3), 0.5, (0.1, 0.9), cover=1.0, raised=1e-3, inset=(0.05, 0.3))
    part = surface()
    corners = np.array([[0, 0, 0], [2, 0, 0], [1.5, 1, 0], [0.2, 1.0, 0]])  # no parallelogram
    part.placed([5, 6, 7], facing([1, 1, 1])).quad(corners, mosaic)
    model = part.build()
    normals = model.normals()
    np.testing.assert_allclose(normals, np.broadcast_to(normals[0], normals.shape), atol=1e-9)
    height = (model.vertices - [5, 6, 7]) @ normals[0]
    np.testing.assert_allclose(height[:4], 0, atol=1e-12)
    np.testing.assert_allclose(height[4:], 1e-3, atol=1e-12)
    assert len(model.faces) == 2 + 2 * 4 * 3
    assert set(model.albedo[2:]) == {0.1, 0.9}
    area = np.linalg.norm(
        np.cross(*(model.vertices[model.faces[:, k]] - model.vertices[model.faces[:, 0]] for k in (1, 2))), axis=1
    )
    # each inset of two corners of an edge takes 10 to 60 % of the edge
    assert 0.4**2 < area[2:].sum() / area[:2].sum() < 0.9**2
    plane = (model.vertices - [5, 6, 7]) @ facing([1, 1, 1])[:, :2]
    patches = plane[4:].reshape(-1, 4, 2)
    for k, patch in enumerate(patches):
        for other in np.delete(patches, k, axis=0):
            assert separated(patch, other)


def separated(a, b):
    """Whether a line along an edge of one of the convex polygons (4, 2) keeps them apart."""
    for p in (a, b):
        edges = np.roll(p, -1, axis=0) - p
        for normal in np.stack([edges[:, 1], -edges[:, 0]], axis=1):
            s, t = a @ normal, b @ normal
            if s.max() < t.min() or t.max() < s.min():
                return True
    return False
