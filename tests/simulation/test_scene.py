"""A simulated scene and its truth, on a small sensor."""

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from esfo_core.errors import OptionError, SimulationError
from esfo_core.events import NS_PER_S
from esfo_core.recordings import open_recording
from esfo_core.tracks import Tracks
from esfo_simulation.scene import VIEWS, MotionOptions, SceneOptions, simulate, view_axis
from esfo_simulation.scene_files import is_written, topspin, write_scene
from esfo_simulation.sensor.options import SensorOptions

FILES = ("scene.mcap", "scene.truth.json", "scene.ply", "scene.points.ply", "scene.tracks.csv")
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
    assert events["t"][-1] - events["t"][0] <= 1.2 / 2.0 * NS_PER_S
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_same_options_same_bytes(recorded, tmp_path):
    path, _, _ = recorded
    write_scene(SMALL, tmp_path / "scene.mcap")
    for name in FILES:
        assert (tmp_path / name).read_bytes() == (path.parent / name).read_bytes(), name


def test_truth_file_and_mesh_say_the_same_as_the_truth(recorded):
    path, truth, _ = recorded
    content = json.loads(path.with_suffix(".truth.json").read_text())
    assert content["spin_rate_hz"] == 2.0
    np.testing.assert_array_equal(content["axis"], view_axis(*VIEWS["diagonal"]))
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
        R, translation = orbit.world_to_camera((t - spin.t0) / NS_PER_S)
        np.testing.assert_allclose(vertices @ R.T + translation, spin.transform(vertices, t), atol=1e-12)


@pytest.mark.parametrize("view", VIEWS)
def test_vertices_stay_in_the_window_and_move_half_a_pixel_a_frame(view):
    scene = simulate(replace(SMALL, view=view))
    simulation = scene.simulation
    w, vertices = simulation.window, simulation.model.vertices
    before = None
    for t in simulation.times[: simulation.turn + 1]:
        R, T = scene.motion.pose(t)
        uv = scene.camera.project(vertices @ R.T + T)
        assert (uv >= [w.x, w.y]).all()
        assert (uv <= [w.x + w.width - 1, w.y + w.height - 1]).all()
        if before is not None:
            assert np.linalg.norm(uv - before, axis=1).max() <= 0.5 * 1.001
        before = uv
    assert 0.5 < w.height / simulation.camera.height < 1.0


def test_the_frames_of_a_turn_come_again():
    scene = simulate(replace(SMALL, revolutions=2.3, motion=MotionOptions(rate_slope_hz_s=-0.3)))
    simulation = scene.simulation
    turn = simulation.turn
    assert 2 * turn < len(simulation.times) <= 3 * turn
    for k in (0, 1, turn // 2, len(simulation.times) - 1 - turn):
        for pose, again in zip(*(scene.motion.pose(simulation.times[i]) for i in (k, k + turn)), strict=True):
            np.testing.assert_allclose(pose, again, atol=1e-9)


def test_without_noise_events_lie_where_the_mesh_is_and_only_noise_elsewhere():
    noisy = simulate(replace(SMALL, revolutions=0.3, sensor=SensorOptions(leak_hz=10.0, shot_hz=0.0, noise_spread=0.0)))
    quiet = simulate(replace(SMALL, revolutions=0.3, sensor=SensorOptions(leak_hz=0.0, shot_hz=0.0)))
    w = quiet.simulation.window

    def outside(events):
        x, y = events["x"].astype(int), events["y"].astype(int)
        return (x < w.x) | (x >= w.x + w.width) | (y < w.y) | (y >= w.y + w.height)

    assert not outside(np.concatenate(list(quiet.chunks()))).any()
    stray = outside(np.concatenate(list(noisy.chunks()))).sum()
    expected = 10.0 * (160 * 120 - w.width * w.height) * 0.3 / 2.0
    assert stray == pytest.approx(expected, abs=4 * np.sqrt(expected))


def test_every_event_is_near_the_silhouette_of_its_moment():
    scene = simulate(replace(SMALL, revolutions=0.1, sensor=SensorOptions(leak_hz=0.0, shot_hz=0.0)))
    events = np.concatenate(list(scene.chunks()))
    for event in events[:: len(events) // 40]:
        R, T = scene.motion.pose(float(event["t"]))
        model = scene.simulation.model
        triangles = scene.camera.project(model.vertices @ R.T + T)[model.faces]
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
        ({"focal_px": 400.0, "distance_m": 0.8}, SimulationError, "leaves the view"),
        ({"rate_hz": -1.0}, OptionError, "-1.0"),
        ({"rate_hz": float("nan")}, OptionError, "nan"),
        ({"view": "askew"}, OptionError, "askew"),
        ({"object": "teapot"}, OptionError, "teapot"),
        ({"speed": "still", "rate_hz": 0.0}, SimulationError, "needs duration_s"),
        ({"revolutions": 5.0, "motion": MotionOptions(rate_slope_hz_s=-0.5)}, SimulationError, "after 4.000 turns"),
        ({"motion": MotionOptions(velocity_x_m_s=1.0)}, SimulationError, "leaves the view"),
        ({"mesh": "none.ply"}, SimulationError, "none.ply"),
    ],
)
def test_impossible_scenes_are_refused_with_the_value(change, error, value):
    with pytest.raises(error, match=value):
        simulate(replace(SMALL, **change))


def test_more_events_than_asked_for_are_refused(tmp_path):
    with pytest.raises(SimulationError, match=r"more than 1000 events after 0\.0"):
        write_scene(replace(SMALL, max_events=1000), tmp_path / "scene.mcap")
    assert not list(tmp_path.iterdir())


def test_true_tracks_are_where_the_truth_has_the_points(recorded):
    path, truth, _ = recorded
    tracks = Tracks.read_csv(path.with_suffix(".tracks.csv"))
    points = trimesh.load(path.with_suffix(".points.ply")).vertices
    camera = open_recording(path).camera
    assert len(points) == 300
    assert tracks.track_id.max() < 300
    for t in np.unique(tracks.t)[::7]:
        rows = tracks.t == t
        uv = camera.project(truth.spin.transform(points[tracks.track_id[rows]], int(t)))
        # float32 in both files
        np.testing.assert_allclose(tracks.uv[rows], uv, atol=1e-3)


def test_a_scene_is_written_once(recorded):
    path, _, _ = recorded
    assert is_written(SMALL, path)
    assert not is_written(replace(SMALL, seed=2), path)
    assert not is_written(SMALL, path.with_name("other.mcap"))


def test_the_scenes_of_the_paper():
    scenes = topspin(SMALL)
    assert len(scenes) == 72
    assert {"soho-sideon-fast", "hubble-diagonal-med", "switch-perpendicular-slow", "dualshock-topdown-med"} < set(
        scenes
    )
    assert {"hubble-topdown-fast", "tdrs-sideon-med", "camera-diagonal-fast"} < set(scenes)
    assert scenes["camera-diagonal-fast"] == replace(SMALL, object="camera", view="diagonal", speed="fast")


def test_what_the_read_out_loses_is_said(tmp_path):
    sensor = SensorOptions(readout_mevs=0.05, readout_queue=100)
    truth = write_scene(replace(SMALL, revolutions=0.2, sensor=sensor), tmp_path / "scene.mcap")
    content = json.loads((tmp_path / "scene.truth.json").read_text())
    assert content["events_lost"] == truth.lost > 0
    assert truth.events <= 0.05e6 * 0.1 + 100
