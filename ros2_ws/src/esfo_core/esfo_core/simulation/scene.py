"""A spinning satellite before a static event camera, simulated with exact truth."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from esfo_core.camera import Camera
from esfo_core.errors import SimulationError
from esfo_core.events import EventArray
from esfo_core.options import check, option
from esfo_core.orbit import NANOSECONDS, Spin, Vector, object_frame, rotation
from esfo_core.recordings import write_mcap
from esfo_core.simulation.contrast import Sensor, SensorOptions
from esfo_core.simulation.renderer import BLUR_REACH, Light, Renderer, Window
from esfo_core.simulation.objects.hubble import hubble
from esfo_core.simulation.surface import Model
from esfo_core.simulation.truth import Truth

VIEWS = {"topdown": (65.0, 10.0), "sideon": (6.0, 4.0), "perpendicular": (12.0, 83.0), "diagonal": (42.0, 25.0)}
"""Perspectives named as in the paper (Table 1): (elevation, roll) of the axis in degrees.

Elevation 0 is an axis across the view, 90 one towards the camera; roll 0 is an axis upright in the image. The angles
are ours, the paper does not print its own; none is a round one, so that no scene is a special case by chance.
"""

SPEEDS_HZ = {"slow": 0.2, "medium": 0.5, "fast": 1.0}
OBJECTS: dict[str, Callable[[int], Model]] = {"hubble": hubble}

START_NS = 1_000_000_000
"""Sensor time of the first frame: not 0, which ROS takes for no time."""

_LARGEST_STEP_PX = 0.5
_THREADS = 2
_BLUR_PX = 0.65

Progress = Callable[[float], None]


@dataclass(frozen=True)
class SceneOptions:
    """What is simulated."""

    object: str = option("hubble", "the satellite", choices=tuple(OBJECTS))
    view: str = option("diagonal", "perspective, as named in the paper", choices=tuple(VIEWS))
    speed: str = option("medium", "spin rate by name: 0.2, 0.5 or 1 Hz", choices=tuple(SPEEDS_HZ))
    rate_hz: float = option(0.0, "spin rate in Hz; 0: by `speed`", 0.0, 1000.0)
    revolutions: float = option(2.5, "turns to simulate", 0.01, 1000.0)
    width: int = option(480, "sensor width in px", 16, 4096)
    height: int = option(360, "sensor height in px", 16, 4096)
    focal_px: float = option(0.0, "focal length in px; 0: 1.25 times the width", 0.0, 1e5)
    distance_m: float = option(0.8, "distance from the camera to the object in m", 0.01, 1000.0)
    seed: int = option(1, "seed of the surface pattern and of all noise", 0, 2**31)
    sensor: SensorOptions = field(default_factory=SensorOptions)


@dataclass(frozen=True)
class Simulation:
    """A scene that is ready to be recorded.

    camera: of the recording. spin: the motion, with t0 the time of the first frame, metres. model: the object in the
    coordinates of `spin`. window: the part of the sensor that the object reaches. frames: per turn.
    """

    options: SceneOptions
    camera: Camera
    spin: Spin
    model: Model
    window: Window
    frames: int

    def chunks(self, progress: Progress | None = None) -> Iterator[EventArray]:
        """Yield the events of each step between two frames, sorted by time, ns; steps without events are left out.

        One turn is rendered once, kept in a temporary file, and used again in every revolution.
        """
        renderer = Renderer(self.model, self.camera, self.window, Light(), _BLUR_PX)
        steps = round(self.options.revolutions * self.frames)
        report = progress or (lambda share: None)
        with tempfile.TemporaryFile(prefix="esfo_frames_") as file:
            shape = (min(steps + 1, self.frames), self.window.height, self.window.width)
            turn = np.memmap(file, np.uint16, "w+", shape=shape)
            for share in self._render(renderer, turn):
                report(0.5 * share)

            rng = np.random.default_rng([self.options.seed, 1])
            size, origin = (self.camera.width, self.camera.height), (self.window.x, self.window.y)
            sensor = Sensor(turn[0], renderer.levels, size, origin, self.options.sensor, rng)
            step_ns = NANOSECONDS / (self.spin.rate_hz * self.frames)
            # Every border is computed once: a step may not end a rounding error after the next one begins.
            borders = self.spin.t0 + step_ns * np.arange(steps + 1)
            for k in range(steps):
                events = sensor.step(turn[(k + 1) % self.frames], (float(borders[k]), float(borders[k + 1])))
                report(0.5 + 0.5 * (k + 1) / steps)
                if len(events):
                    yield events

    def _render(self, renderer: Renderer, turn: NDArray[np.uint16]) -> Iterator[float]:
        def render(k: int) -> NDArray[np.uint16]:
            return renderer.render(rotation(self.spin.axis, 2 * np.pi * k / self.frames), self.spin.center)

        with ThreadPoolExecutor(_THREADS) as pool:
            images = pool.map(render, range(len(turn)))
            for k, image in enumerate(images):
                turn[k] = image
                yield (k + 1) / len(turn)

    def truth(self, first_event: int, events: int) -> Truth:
        """Return the truth as a reader of the recording sees it: at the time of the first event, ns."""
        spin = Spin(self.spin.axis, self.spin.rate_hz, self.spin.center, first_event)
        o = self.options
        return Truth(spin, o.revolutions, o.object, o.view, o.seed, events)

    def model_at(self, t: int) -> Model:
        """Return the object in its coordinates at time `t` ns."""
        return self.model.moved(rotation(self.spin.axis, float(self.spin.angle(np.asarray(t)))), np.zeros(3))


def view_axis(view: str) -> Vector:
    """Spin axis (3,) in the camera's optical frame of a named perspective."""
    elevation, roll = np.radians(VIEWS[view])
    upright = np.array([0.0, -np.cos(elevation), -np.sin(elevation)])
    return np.asarray(rotation(np.array([0.0, 0, 1]), roll) @ upright)


def simulate(options: SceneOptions) -> Simulation:
    """Set a scene up. Raises OptionError for impossible options and SimulationError for an object outside the view."""
    check(options)
    camera = Camera.pinhole(options.width, options.height, options.focal_px or 1.25 * options.width)
    axis = view_axis(options.view)
    # A little beside the optical axis, like everything that is set up by hand.
    center = options.distance_m * np.array([0.0075, -0.005, 1.0])
    rate = options.rate_hz or SPEEDS_HZ[options.speed]
    model = OBJECTS[options.object](options.seed).moved(object_frame(axis), np.zeros(3))
    spin = Spin(axis, rate, center, START_NS)
    window, speed_px = _reach(model, spin, camera)
    return Simulation(options, camera, spin, model, window, int(np.ceil(speed_px / _LARGEST_STEP_PX)))


def _reach(model: Model, spin: Spin, camera: Camera) -> tuple[Window, float]:
    """Find the window that the model covers in one turn, and the longest image path of a vertex in px per turn."""
    angles = np.linspace(0, 2 * np.pi, 361)
    paths = []
    for angle in angles:
        X = model.vertices @ rotation(spin.axis, float(angle)).T + spin.center
        if X[:, 2].min() <= 1e-3:
            raise SimulationError(f"the object reaches the camera: a vertex comes to z = {X[:, 2].min():.3f} m")
        paths.append(camera.project(X))
    uv = np.array(paths)
    low = np.floor(uv.min(axis=(0, 1))).astype(int) - BLUR_REACH - 1
    high = np.ceil(uv.max(axis=(0, 1))).astype(int) + BLUR_REACH + 1
    if (low < 0).any() or (high >= [camera.width, camera.height]).any():
        raise SimulationError(
            f"the object leaves the view: it covers columns {low[0]}..{high[0]} and rows {low[1]}..{high[1]} of "
            f"{camera.width}x{camera.height} px; use a larger distance_m or a shorter focal_px"
        )
    step = np.linalg.norm(np.diff(uv, axis=0), axis=2).max()
    return Window(int(low[0]), int(low[1]), int(high[0] - low[0] + 1), int(high[1] - low[1] + 1)), float(360 * step)


def write_scene(options: SceneOptions, path: Path, progress: Progress | None = None) -> Truth:
    """Simulate and write `path` (MCAP), `<stem>.truth.json` and `<stem>.ply`, the mesh at the first event.

    The same options give the same bytes. Raises SimulationError and RecordingError.
    """
    simulation = simulate(options)
    first: list[int] = []

    def watched() -> Iterator[EventArray]:
        for events in simulation.chunks(progress):
            if not first:
                first.append(int(events["t"][0]))
            yield events

    count = write_mcap(path, watched(), simulation.camera)
    truth = simulation.truth(first[0], count)
    truth.write_json(path.with_suffix(".truth.json"))
    simulation.model_at(first[0]).to_trimesh().export(path.with_suffix(".ply"))
    return truth
