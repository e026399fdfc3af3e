"""The events of a scene lie on the edges of the model as its truth moves it: in place, in time and in sense."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from esfo_core.events import NS_PER_S
from esfo_core.orbit import Spin, rotation
from esfo_simulation.render.renderer import Light, Renderer
from esfo_simulation.scene import SceneOptions, simulate
from esfo_simulation.sensor.options import SensorOptions

BLUR_PX = 0.65
MILLISECOND = 1_000_000
OPTIONS = SceneOptions(
    width=320,
    height=240,
    rate_hz=1.0,
    revolutions=0.06,
    seed=3,
    sensor=SensorOptions(leak_hz=0.0, shot_hz=0.0, refractory_us=0.0),
)


@pytest.fixture(scope="module", params=["diagonal", "sideon"])
def scene_and_events(request):
    scene = simulate(replace(OPTIONS, view=request.param))
    return scene, np.concatenate(list(scene.chunks()))


def off_edges(scene, events, spin, t):
    """Distances (N,) in px of events to the edges of a sharp picture of the model at time t (ns)."""
    shot = scene.simulation
    renderer = Renderer(shot.model, shot.camera, shot.window, Light(), blur_px=0.3)
    image = renderer.render(rotation(spin.axis, float(spin.angle(np.asarray(t)))), spin.center) * renderer.levels.step
    down, right = (np.abs(np.diff(image, axis=a)) > 0.1 for a in (0, 1))
    edge = np.zeros(image.shape, bool)
    edge[:-1] |= down
    edge[1:] |= down
    edge[:, :-1] |= right
    edge[:, 1:] |= right
    y, x = events["y"].astype(int) - shot.window.y, events["x"].astype(int) - shot.window.x
    return distance_transform_edt(~edge)[y, x]


def around(events, t, half_ns=MILLISECOND):
    chosen = events[np.abs(events["t"] - t) < half_ns]
    assert len(chosen) > 300
    return chosen


def test_events_lie_on_the_edges_of_the_true_motion(scene_and_events):
    scene, events = scene_and_events
    t = int(events["t"][0]) + round(0.05 * NS_PER_S)
    now, spin = around(events, t), scene.spin
    # beyond three times the blur an edge changes no light: what is left are faces that turn to or from the light
    assert (off_edges(scene, now, spin, t) <= 3 * BLUR_PX).mean() > 0.96
    opposite = Spin(-spin.axis, spin.rate_hz, spin.center, spin.t0)
    assert (off_edges(scene, now, opposite, t) <= 3 * BLUR_PX).mean() < 0.9


def test_events_are_on_time(scene_and_events):
    scene, events = scene_and_events
    t = int(events["t"][0]) + round(0.03 * NS_PER_S)
    now = around(events, t)
    offsets = np.arange(-8, 9)
    distance = [off_edges(scene, now, scene.spin, t + k * MILLISECOND).mean() for k in offsets]
    # what moves fastest takes about 2 ms per pixel; an edge fires up to a blur before and after it passes
    assert abs(offsets[np.argmin(distance)]) <= 1
    assert distance[0] > 1.5 * min(distance) < distance[-1] / 1.5


def test_later_turns_repeat_the_first():
    # a pixel with unequal thresholds up and down is never twice in the same state
    equal = replace(OPTIONS.sensor, mismatch=0.0)
    scene = simulate(replace(OPTIONS, width=160, height=120, revolutions=3.0, sensor=equal))
    events = np.concatenate(list(scene.chunks()))
    turn = (events["t"] - scene.spin.t0) * scene.spin.rate_hz / NS_PER_S
    first, second, third = (np.sort(events[(turn >= k) & (turn < k + 1)], order=["t", "y", "x"]) for k in range(3))
    # only the first turn still knows the random state in which the pixels began
    assert len(first) == pytest.approx(len(second), rel=0.01)
    assert len(second) == len(third)
    for name in ("x", "y", "p"):
        np.testing.assert_array_equal(second[name], third[name])
    assert np.abs(third["t"] - second["t"] - NS_PER_S / scene.spin.rate_hz).max() <= 1000


def test_the_mesh_of_a_later_time_is_the_turned_one(scene_and_events):
    scene, _ = scene_and_events
    t = scene.spin.t0 + round(0.3 * NS_PER_S)
    moved = scene.spin.transform(scene.simulation.model.vertices, t)
    np.testing.assert_allclose(scene.model_at(t).vertices + scene.spin.center, moved, atol=1e-12)
    # seen from the time t on, that mesh moves as before
    later = Spin(scene.spin.axis, scene.spin.rate_hz, scene.spin.center, t)
    end = t + round(0.2 * NS_PER_S)
    expected = scene.spin.transform(scene.simulation.model.vertices, end)
    np.testing.assert_allclose(later.transform(scene.model_at(t).vertices, end), expected, atol=1e-12)
