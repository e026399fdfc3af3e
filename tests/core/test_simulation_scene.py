"""A simulated scene and its truth, on a small sensor."""

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from esfo_core.errors import OptionError, SimulationError
from esfo_core.orbit import NANOSECONDS, rotation
from esfo_core.recordings import open_recording
from esfo_core.simulation.contrast import SensorOptions
from esfo_core.simulation.scene import VIEWS, SceneOptions, simulate, view_axis, write_scene

SMALL = SceneOptions(width=160, height=120, rate_hz=2.0, revolutions=1.2)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "scene.mcap"
    shares = []
    truth = write_scene(SMALL, path, shares.append)
    return path, truth, shares


def test_events_follow_each_other_and_truth_starts_with_the_first(recorded):
    path, truth, shares = recorded
    events = np.concatenate(list(open_recording(path).chunks()))
    assert len(events) == truth.events > 20_000
    assert (np.diff(events["t"]) >= 0).all()
    assert events["t"][0] == truth.spin.t0
    assert events["t"][-1] - events["t"][0] <= 1.2 / 2.0 * NANOSECONDS
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_same_options_same_bytes(recorded, tmp_path):
    path, _, _ = recorded
    write_scene(SMALL, tmp_path / "scene.mcap")
    for name in ("scene.mcap", "scene.truth.json", "scene.ply"):
        assert (tmp_path / name).read_bytes() == (path.parent / name).read_bytes(), name


def test_truth_file_and_mesh_say_the_same_as_the_truth(recorded):
    path, truth, _ = recorded
    content = json.loads(path.with_suffix(".truth.json").read_text())
    assert content["spin_rate_hz"] == 2.0
    np.testing.assert_array_equal(content["axis"], view_axis("diagonal"))
    assert content["t0_ns"] == truth.spin.t0
    assert content["radius"] == content["orbit"]["r"] == pytest.approx(truth.spin.paper_orbit().radius)
    mesh = trimesh.load(path.with_suffix(".ply"), process=False)
    expected = simulate(SMALL).model_at(truth.spin.t0)
    # PLY stores float32.
    np.testing.assert_allclose(mesh.vertices, expected.vertices, atol=1e-7)
    np.testing.assert_array_equal(mesh.faces, expected.faces)


def test_a_vertex_of_the_mesh_is_where_the_paper_sees_it(recorded):
    _, truth, _ = recorded
    vertices = simulate(SMALL).model_at(truth.spin.t0).vertices
    orbit, spin = truth.spin.paper_orbit(), truth.spin
    for t in (spin.t0, spin.t0 + 123_456_789, spin.t0 + 480_000_000):
        R, translation = orbit.world_to_camera((t - spin.t0) / NANOSECONDS)
        np.testing.assert_allclose(vertices @ R.T + translation, spin.transform(vertices, t), atol=1e-12)


@pytest.mark.parametrize("view", VIEWS)
def test_vertices_stay_in_the_window_and_move_half_a_pixel_a_frame(view):
    scene = simulate(replace(SMALL, view=view))
    w = scene.window
    angles = 2 * np.pi * np.arange(scene.frames + 1) / scene.frames
    before = None
    for angle in angles:
        uv = scene.camera.project(scene.model.vertices @ rotation(scene.spin.axis, angle).T + scene.spin.center)
        assert (uv >= [w.x, w.y]).all()
        assert (uv <= [w.x + w.width - 1, w.y + w.height - 1]).all()
        if before is not None:
            assert np.linalg.norm(uv - before, axis=1).max() <= 0.5 * 1.001
        before = uv
    assert 0.5 < w.height / scene.camera.height < 1.0


def test_without_noise_events_lie_where_the_mesh_is_and_only_noise_elsewhere():
    noisy = simulate(replace(SMALL, revolutions=0.3, sensor=SensorOptions(noise_hz=20.0)))
    quiet = simulate(replace(SMALL, revolutions=0.3, sensor=SensorOptions(noise_hz=0.0)))
    w = quiet.window

    def outside(events):
        x, y = events["x"].astype(int), events["y"].astype(int)
        return (x < w.x) | (x >= w.x + w.width) | (y < w.y) | (y >= w.y + w.height)

    assert not outside(np.concatenate(list(quiet.chunks()))).any()
    stray = outside(np.concatenate(list(noisy.chunks()))).sum()
    expected = 20.0 * (160 * 120 - w.width * w.height) * 0.3 / 2.0
    assert stray == pytest.approx(expected, abs=4 * np.sqrt(expected))


def test_every_event_is_near_the_silhouette_of_its_moment():
    scene = simulate(replace(SMALL, revolutions=0.1, sensor=SensorOptions(noise_hz=0.0)))
    events = np.concatenate(list(scene.chunks()))
    for event in events[:: len(events) // 40]:
        R = rotation(scene.spin.axis, float(scene.spin.angle(np.asarray(event["t"]))))
        X = scene.model.vertices @ R.T + scene.spin.center
        triangles = scene.camera.project(X)[scene.model.faces]
        assert distance_to_triangles(np.array([event["x"], event["y"]], float), triangles) < 3.5


def distance_to_triangles(point, triangles):
    """Distance in px of a point (2,) to the nearest of (F, 3, 2) triangles, 0 inside one."""
    a, b = triangles, np.roll(triangles, -1, axis=1)
    along = np.einsum("fki,fki->fk", point - a, b - a) / np.maximum(np.einsum("fki,fki->fk", b - a, b - a), 1e-12)
    nearest = a + np.clip(along, 0, 1)[..., None] * (b - a)
    side = (b - a)[..., 0] * (point - a)[..., 1] - (b - a)[..., 1] * (point - a)[..., 0]
    if ((side > 0).all(axis=1) | (side < 0).all(axis=1)).any():
        return 0.0
    return float(np.linalg.norm(point - nearest, axis=2).min())


@pytest.mark.parametrize(
    ("change", "error", "value"),
    [
        ({"distance_m": 0.1}, SimulationError, "z = "),
        ({"distance_m": 0.4}, SimulationError, "leaves the view"),
        ({"focal_px": 400.0}, SimulationError, "leaves the view"),
        ({"rate_hz": -1.0}, OptionError, "-1.0"),
        ({"rate_hz": float("nan")}, OptionError, "nan"),
        ({"view": "askew"}, OptionError, "askew"),
        ({"object": "teapot"}, OptionError, "teapot"),
        ({"sensor": SensorOptions(threshold=0.0)}, OptionError, "0.0"),
    ],
)
def test_impossible_scenes_are_refused_with_the_value(change, error, value):
    with pytest.raises(error, match=value):
        simulate(replace(SMALL, **change))
