"""True tracks: visibility against rays cast one by one, and where the points are."""

import numpy as np
import pytest
import trimesh

from esfo_core.camera import Camera
from esfo_core.orbit import Spin, object_frame
from esfo_simulation.landmarks import choose_points, corner_vertices, true_tracks, visible
from esfo_simulation.motion import BodyMotion
from esfo_simulation.objects.hubble import hubble
from esfo_simulation.render.surface import Model, Mosaic, Surface

CAMERA = Camera.pinhole(200, 160, 260.0)
SPIN = Spin(np.array([0.0, -0.8, -0.6]), 1.0, np.array([0.0, 0.0, 0.8]), 0)


def ray_hits_first(X, triangles, k):
    """Whether the straight line from the camera to X[k] meets a triangle that faces the camera before X[k]."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    facing = np.einsum("fi,fi->f", normal, a) < 0
    # a + s (b - a) + r (c - a) = u X[k], Cramer's rule
    p = np.broadcast_to(-X[k], a.shape)
    det = np.einsum("fi,fi->f", b - a, np.cross(c - a, p))
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.einsum("fi,fi->f", -a, np.cross(c - a, p)) / det
        r = np.einsum("fi,fi->f", b - a, np.cross(-a, p)) / det
        u = np.einsum("fi,fi->f", b - a, np.cross(c - a, -a)) / det
    inside = (s > 1e-9) & (r > 1e-9) & (s + r < 1 - 1e-9)
    return bool((facing & inside & (u > 0) & (u < 1 - 1.5e-4)).any())


def test_hidden_points_are_those_whose_ray_is_stopped():
    model = hubble(1).moved(object_frame(SPIN.axis), np.zeros(3))
    points = choose_points(model, 400, 3)
    shown = []
    for turns in (0.0, 0.13, 0.4, 0.77):
        pose = BodyMotion(SPIN).pose(turns * 1e9)
        uv, seen = visible(model, points, CAMERA, pose)
        X = model.vertices @ pose[0].T + pose[1]
        np.testing.assert_allclose(uv, CAMERA.project(X[points]))
        normals = model.normals() @ pose[0].T
        for p in range(len(points)):
            corner = (model.faces == points[p]).any(axis=1)
            turned_to = (normals[corner] @ X[points[p]] < 0).any()
            assert seen[p] == (turned_to and not ray_hits_first(X, X[model.faces], points[p])), points[p]
        shown.append(seen.mean())
    assert 0.15 < min(shown) < max(shown) < 0.6  # about half of a convex body turns away, and parts hide parts


def wall(z, albedo=0.5):
    return np.array([[-1, -1, z], [-1, 1, z], [1, 1, z], [1, -1, z]], float) * [0.1, 0.1, 1], albedo


def test_a_wall_hides_what_is_behind_it_and_not_what_lies_on_it():
    near, far, patch = wall(1.0)[0], wall(1.1)[0] * [0.5, 0.5, 1], wall(0.9996)[0] * [0.5, 0.5, 1]
    vertices = np.concatenate([near, far, patch])
    faces = np.array([[k, k + 1, k + 2] for k in (0, 4, 8)] + [[k, k + 2, k + 3] for k in (0, 4, 8)], np.int32)
    model = Model(vertices, faces, np.full(6, 0.5))
    _, seen = visible(model, np.arange(12), CAMERA, (np.eye(3), np.zeros(3)))
    assert seen.tolist() == [True] * 4 + [False] * 4 + [True] * 4


def test_points_outside_the_image_or_behind_the_camera_are_not_seen():
    vertices = wall(1.0)[0] * [20, 1, 1]
    model = Model(vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.full(2, 0.5))
    for T in (np.zeros(3), np.array([0, 0, -2.0])):
        assert not visible(model, np.arange(4), CAMERA, (np.eye(3), T))[1].any()


def test_rows_only_where_a_point_is_seen():
    model = hubble(1).moved(object_frame(SPIN.axis), np.zeros(3))
    points = choose_points(model, 50, 3)
    assert len(np.unique(model.vertices[points], axis=0)) == 50
    times = np.arange(0, 1_000_000_000, 50_000_000)
    tracks = true_tracks(model, points, CAMERA, BodyMotion(SPIN), times)
    assert 0 < len(tracks) < 50 * 20
    for k, t in zip(tracks.track_id[::17], tracks.t[::17], strict=True):
        expected = CAMERA.project(SPIN.transform(model.vertices[points[[k]]], int(t)))
        np.testing.assert_allclose(tracks.uv[(tracks.track_id == k) & (tracks.t == t)], expected, atol=1e-4)


def test_corners_of_a_box_a_cylinder_and_patches():
    box = trimesh.creation.box((1, 2, 3))
    assert len(corner_vertices(plain(box))) == 8
    plate = plain(trimesh.creation.box((1, 2, 3)).subdivide())  # more vertices, no more corners
    assert len(plate.vertices) > 8
    assert len(corner_vertices(plate)) == 8
    assert len(corner_vertices(plain(trimesh.creation.icosphere(3)))) == 0
    assert len(corner_vertices(plain(trimesh.creation.cylinder(1, 2, sections=64)))) == 0  # round edges, no corner
    surface = Surface(np.random.default_rng(1))
    surface.face(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), Mosaic((3, 2), 0.5, (0.1, 0.9), cover=1.0))
    assert len(corner_vertices(surface.build())) == 4 + 4 * 6


def plain(mesh):
    return Model(np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32), np.full(len(mesh.faces), 0.5))


@pytest.mark.parametrize("count", [10, 10**6])
def test_no_point_is_chosen_twice(count):
    model = hubble(1)
    points = choose_points(model, count, 0)
    assert len(points) == min(count, len(corner_vertices(model)))
    assert len(np.unique(model.vertices[points], axis=0)) == len(points)


def test_a_body_without_corners_has_points_all_the_same():
    assert len(choose_points(plain(trimesh.creation.icosphere(2)), 50, 0)) == 50
