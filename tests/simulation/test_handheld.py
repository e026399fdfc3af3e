"""A hand-held camera in its rooms: what is seen, when to look, and the poses in the dataset's own files."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
import trimesh
from scipy.ndimage import center_of_mass
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from esfo_core.camera import Camera
from esfo_core.errors import OptionError, SimulationError
from esfo_core.recordings.event_camera_dataset import read_groundtruth, write_event_camera_dataset
from esfo_simulation.handheld.rooms import ROOMS, WALL_M, corners
from esfo_simulation.handheld.scene import DAVIS240C, HandheldOptions, handheld_scene
from esfo_simulation.handheld.schedule import frame_times_in_view, image_speed, select_ahead
from esfo_simulation.handheld.texture import voronoi_cells
from esfo_simulation.handheld.trajectory import FORWARD, REACH_M, REACH_RAD, random_trajectory
from esfo_simulation.render.renderer import Light, Renderer, Window
from esfo_simulation.render.surface import Model, Surface, circle, facing

SECOND = 10**9
MINUTE = (SECOND, 61 * SECOND)
WHOLE = Window(0, 0, DAVIS240C.width, DAVIS240C.height)


@pytest.fixture(scope="module")
def rooms():
    return {name: make(1) for name, make in ROOMS.items()}


def border_rays(camera):
    """Directions (N, 3) in the optical frame of the pixels round the image."""
    v, u = np.mgrid[: camera.height, : camera.width]
    border = (u == 0) | (v == 0) | (u == camera.width - 1) | (v == camera.height - 1)
    plane = camera.unproject(np.column_stack([u[border], v[border]]))
    return np.column_stack([plane, np.ones(len(plane))])


def test_the_view_never_leaves_the_walls_nor_the_camera_the_room(rooms):
    rays = border_rays(DAVIS240C)
    # The extremes of every component at once, which no trajectory passes.
    for turn in product((-1, -0.5, 0, 0.5, 1), repeat=3):
        seen = rays @ (FORWARD @ Rotation.from_rotvec(turn * np.array(REACH_RAD)).as_matrix()).T
        assert (seen[:, 1] > 0).all()
        hit = seen[:, ::2] / seen[:, 1:2] * (1 + REACH_M[1])
        assert np.abs(hit).max() + max(REACH_M) < WALL_M / 2
    room = rooms["boxes"].vertices
    assert (room.min(axis=0) < -np.array(REACH_M) - 0.3).all()
    assert (room.max(axis=0) > np.array(REACH_M) + 0.3).all()
    beyond = np.maximum(np.abs(room) - REACH_M, 0)
    assert np.linalg.norm(beyond, axis=1).min() > 0.3


@pytest.mark.parametrize(("name", "polygons"), [("shapes", 900), ("poster", 4000), ("boxes", 4000)])
def test_models_are_whole_and_drawn_by_seed(rooms, name, polygons):
    model = rooms[name]
    assert len(np.unique(model.faces[:, 0])) > polygons
    assert np.isfinite(model.normals()).all()
    assert (model.albedo > 0).all()
    assert (model.albedo <= 1).all()
    again, other = ROOMS[name](1), ROOMS[name](2)
    np.testing.assert_array_equal(again.vertices, model.vertices)
    np.testing.assert_array_equal(again.albedo, model.albedo)
    assert other.vertices.shape != model.vertices.shape or not np.allclose(other.vertices, model.vertices)
    # Where the camera rests, it faces the front of everything before it: nothing is seen from behind.
    middle = model.vertices[model.faces].mean(axis=1)
    hidden = (model.normals() * middle).sum(axis=1) >= 0
    if name != "boxes":
        assert not hidden.any()


def test_cells_tile_the_wall():
    half = np.array([1.0, 0.6])
    points = np.random.default_rng(3).uniform(-half, half, (300, 2))
    cells = voronoi_cells(points, half)
    area = perimeter = 0.0
    for point, cell in zip(points, cells, strict=True):
        edge = np.roll(cell, -1, axis=0) - cell
        side = edge[:, 0] * (point - cell)[:, 1] - edge[:, 1] * (point - cell)[:, 0]
        assert (side / np.linalg.norm(edge, axis=1)).min() > -1e-3  # counter-clockwise round its point, up to the grid
        area += ConvexHull(cell).volume
        perimeter += np.linalg.norm(edge, axis=1).sum()
    assert abs(area - 4 * half.prod()) < 1e-3 * perimeter / 2
    assert np.abs(np.concatenate(cells)).max(axis=0) == pytest.approx(half)


def test_corners_are_those_of_the_outlines():
    surface = Surface(np.random.default_rng(0))
    wall = surface.placed((0.0, 2.0, 0.0), facing((0.0, -1.0, 0.0)))
    square = circle(0.1, 4)
    wall.decal(square, 0.2, height=0.0)
    wall.decal(circle(0.1, 32, (1.0, 0.0)), 0.2, height=0.0)
    wall.decal(square + square[0] - square[2], 0.3, height=0.0)  # shares one corner with the first
    found = corners(surface.build())
    expected = np.concatenate([square, square + square[0] - square[2]])
    expected = np.insert(expected, 1, 2.0, axis=1)
    assert len(found) == 7
    assert all(np.linalg.norm(found - corner, axis=1).min() < 1e-12 for corner in expected)


def test_corners_of_the_shapes_are_those_of_triangles_stars_and_others(rooms):
    found = corners(rooms["shapes"])
    inside = found[(np.abs(found[:, ::2]) < WALL_M / 2 - 1e-9).all(axis=1)]
    assert len(found) - len(inside) == 4
    # triangle 3, square and bar 4, hexagon and L 6, star 10, circle none: 33 per seven shapes
    shapes = int(WALL_M / 0.34) ** 2
    sigma = np.sqrt(shapes * np.var([3, 4, 4, 6, 6, 10, 0]))
    assert len(inside) == pytest.approx(shapes * 33 / 7, abs=4 * sigma)


def test_corners_of_another_mesh_are_refused():
    box = trimesh.creation.box()
    with pytest.raises(SimulationError, match="12 faces"):
        corners(Model(np.array(box.vertices), np.array(box.faces, np.int32), np.ones(12)))


def test_selection_equals_its_twin():
    rng = np.random.default_rng(6)
    points, R, T = rng.normal(size=(500, 3)), Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    low, high = np.array([-0.8, -0.5]), np.array([0.6, 0.9])
    index, moved = np.empty(500, np.int64), np.empty((500, 3))
    n = select_ahead(points, R, T, low, high, index, moved)
    X = points @ R.T + T
    plane = X[:, :2] / X[:, 2:]
    expected = np.flatnonzero((X[:, 2] > 0.02) & ((plane > low) & (plane < high)).all(axis=1))
    assert 20 < n < 400
    np.testing.assert_array_equal(index[:n], expected)
    np.testing.assert_allclose(moved[:n], X[expected], atol=1e-14)


@pytest.mark.parametrize("scene", ROOMS)
def test_nothing_in_view_moves_more_than_half_a_pixel_and_no_frame_is_wasted(rooms, scene):
    model, span = rooms[scene], (40.0 * SECOND, 40.3 * SECOND)
    trajectory = random_trajectory("6dof", MINUTE, 4)
    times = frame_times_in_view(trajectory, model, DAVIS240C, span)
    assert (times[0], times[-1]) == span
    assert (np.diff(times) > 0).all()
    rays = border_rays(DAVIS240C)[::5]
    shifts = []
    for k in np.linspace(0, len(times) - 2, 97).astype(int):
        (R, T), (later, T_later) = (trajectory.pose(t) for t in times[k : k + 2])
        points = model.vertices
        if scene != "boxes":  # points of the wall at the border, where the motion is largest
            seen = rays @ R
            points = np.concatenate([points, seen * ((1 + R.T @ T)[1] / seen[:, 1:2]) - R.T @ T])
        X, Y = points @ R.T + T, points @ later.T + T_later
        X, Y = X[ahead := X[:, 2] > 0.02], Y[ahead]
        uv = DAVIS240C.project(X)
        inside = (uv >= 0).all(axis=1) & (uv <= [DAVIS240C.width - 1, DAVIS240C.height - 1]).all(axis=1)
        shifts.append(np.linalg.norm(DAVIS240C.project(Y[inside]) - uv[inside], axis=1).max())
    assert max(shifts) < 0.5
    # Half a pixel at the speed of the fastest; less only where 5 ms hold speeds that differ.
    assert np.mean(shifts) > 0.4


def test_image_speed_of_a_known_turn():
    camera = Camera.pinhole(101, 101, 100.0)

    class Turning:
        def pose(self, t):
            return Rotation.from_rotvec([0, 0, 2.0 * t / SECOND]).as_matrix(), np.zeros(3)

    ahead = np.array([[0.0, 0, 1], [0.2, 0.1, 1], [0.3, 0, -1], [0.9, 0, 1]])
    # a roll of 2 rad/s moves the point 22.4 px off the centre; the others are behind and outside of the view
    assert image_speed(Turning(), ahead, camera, 0.3 * SECOND) == pytest.approx(
        2.0 * 100 * np.hypot(0.2, 0.1), rel=1e-6
    )


def test_a_still_camera_is_looked_at_now_and_then(rooms):
    class Still:
        def pose(self, t):
            return FORWARD.T, np.zeros(3)

    times = frame_times_in_view(Still(), rooms["shapes"], DAVIS240C, (0.0, 0.1 * SECOND))
    np.testing.assert_allclose(times, np.linspace(0, 0.1, 6) * SECOND)


@pytest.fixture(scope="module")
def marked(rooms):
    """Some corners (N, 3) of the shapes, and a renderer that draws a dark marker of 5 mm, a pixel, on each of them."""
    chosen = corners(rooms["shapes"])[::7]
    surface = Surface(np.random.default_rng(0))
    for corner in chosen:
        surface.placed(corner, facing((0.0, -1.0, 0.0))).decal(circle(0.005, 4), 0.05, height=0.0)
    light = Light(ambient=1.0, diffuse=0.0, background=0.8)
    return chosen, Renderer(surface.build(), DAVIS240C, WHOLE, light, 0.65)


@pytest.mark.parametrize("begin", [1.0, 55.0])
def test_a_corner_is_drawn_where_the_poses_of_the_file_project_it(tmp_path, marked, begin):
    trajectory = random_trajectory("6dof", MINUTE, 7)
    write_event_camera_dataset(tmp_path, [], trajectory, DAVIS240C)
    poses = read_groundtruth(tmp_path / "groundtruth.txt")
    chosen, renderer = marked
    checked = 0
    for t in (begin * SECOND + np.arange(6) * 152_345_678).astype(np.int64):
        R, T = (values[0] for values in poses.world_to_camera(t))
        X = chosen @ R.T + T
        uv = DAVIS240C.project(X[X[:, 2] > 0.3])
        alone = np.linalg.norm(uv[:, None] - uv[None], axis=2)[~np.eye(len(uv), dtype=bool)].reshape(len(uv), -1)
        inside = ((uv > 10) & (uv < [DAVIS240C.width - 11, DAVIS240C.height - 11])).all(axis=1)
        image = np.exp(renderer.levels.log_radiance(renderer.render(*trajectory.pose(float(t)))))
        for column, row in uv[inside & (alone.min(axis=1) > 15)]:
            x, y = round(column) - 5, round(row) - 5
            dark = 0.8 - image[y : y + 11, x : x + 11]
            # the centre of mass of a marker is that of its image
            drawn = center_of_mass(np.where(dark > 1e-3, dark, 0.0))
            assert np.hypot(column - x - drawn[1], row - y - drawn[0]) < 0.5
            checked += 1
    assert checked > 30


def test_scene_is_set_up_from_options():
    options = HandheldOptions(scene="shapes", motion="rotation", duration_s=0.05, seed=3)
    scene = handheld_scene(options)
    assert scene.trajectory.span == (SECOND, SECOND + SECOND // 20)
    assert scene.simulation.window == WHOLE
    assert scene.simulation.times[0] == SECOND
    assert scene.simulation.times[-1] == SECOND + SECOND // 20
    fast = handheld_scene(HandheldOptions(scene="shapes", motion="rotation", duration_s=0.05, seed=3, speed=4.0))
    assert len(fast.simulation.times) > 2 * len(scene.simulation.times)


@pytest.mark.parametrize(
    ("change", "value"),
    [({"scene": "lounge"}, "lounge"), ({"motion": "jump"}, "jump"), ({"duration_s": 0.0}, "0.0"), ({"speed": 9}, "9")],
)
def test_impossible_options_are_refused(change, value):
    with pytest.raises(OptionError, match=value):
        handheld_scene(HandheldOptions(**change))
