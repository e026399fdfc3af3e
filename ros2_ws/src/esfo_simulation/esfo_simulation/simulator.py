"""From a moving model to events: frames rendered ahead in threads, one turn kept, the sensor after them in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field

import lz4.block
import numpy as np
from numpy.typing import NDArray

from esfo_core.camera import Camera
from esfo_core.errors import SimulationError
from esfo_core.events import NS_PER_S, EventArray
from esfo_core.orbit import Matrix
from esfo_simulation.motion import RigidMotion
from esfo_simulation.render.renderer import Light, Renderer, Window
from esfo_simulation.render.surface import Model
from esfo_simulation.sensor.event_sensor import Sensor
from esfo_simulation.sensor.options import SensorOptions

LARGEST_STEP_PX = 0.5
"""Motion of the image between two frames: beyond about the blur, light no longer changes linearly between them."""

LONGEST_STEP_NS = 20e6
"""Time between two frames where little moves: it bounds how much a reader has to wait for."""

BLUR_PX = 0.65
"""Standard deviation of the optical blur of a well-focused lens on pixels of this size."""

_THREADS = 2
_AHEAD = 8

Progress = Callable[[float], None]
Frame = NDArray[np.uint16]


@dataclass(frozen=True)
class Simulation:
    """A scene that is ready to be recorded.

    times: (K + 1,) of the frames, ns. turn: the frame k looks like the frame k modulo `turn`; K + 1 if none repeats.
    window: the part of the sensor that the model ever covers. max_events: how many events there may be.
    """

    model: Model
    motion: RigidMotion
    camera: Camera
    window: Window
    times: NDArray[np.float64]
    turn: int
    sensor: SensorOptions = field(default_factory=SensorOptions)
    light: Light = field(default_factory=Light)
    seed: int = 0
    max_events: int = 10**12

    def chunks(self, progress: Progress | None = None) -> Generator[EventArray, None, int]:
        """Yield the events of each step between two frames, sorted by time, ns; steps without events are left out.

        progress: called with the share that is done. Returns how many events a busy read-out lost. Raises
        SimulationError for more than `max_events` events.
        """
        renderer = Renderer(self.model, self.camera, self.window, self.light, BLUR_PX)
        frames = self._frames(renderer)
        size, origin = (self.camera.width, self.camera.height), (self.window.x, self.window.y)
        rng = np.random.default_rng([self.seed, 1])
        sensor = Sensor(next(frames), renderer.levels, size, origin, self.sensor, rng)
        count, steps = 0, len(self.times) - 1
        for k in range(steps + 1):
            if k < steps:
                events = sensor.step(next(frames), (float(self.times[k]), float(self.times[k + 1])))
            else:
                events = sensor.flush()
            count += len(events)
            if count > self.max_events:
                seconds = (self.times[min(k + 1, steps)] - self.times[0]) / NS_PER_S
                raise SimulationError(f"more than {self.max_events} events after {seconds:.3f} s of the scene")
            if progress is not None:
                progress((k + 1) / (steps + 1))
            if len(events):
                yield events
        return sensor.dropped

    def _frames(self, renderer: Renderer) -> Iterator[Frame]:
        """Yield the frames in order. What comes again is kept compressed: a turn is some thousand frames."""
        shape = (self.window.height, self.window.width)
        last = len(self.times) - 1
        kept: list[bytes] = []

        def make(k: int) -> tuple[Frame, bytes]:
            if k >= self.turn:
                data = kept[k % self.turn]
                return np.frombuffer(lz4.block.decompress(data), np.uint16).reshape(shape), data
            frame = renderer.render(*self.motion.pose(float(self.times[k])))
            return frame, lz4.block.compress(frame) if k + self.turn <= last else b""

        def take() -> Frame:
            frame, data = waiting.popleft().result()
            if len(kept) < self.turn <= last:
                kept.append(data)
            return frame

        # A frame is repeated only after its first appearance was yielded.
        ahead = min(_AHEAD, self.turn - 1)
        waiting: deque[Future[tuple[Frame, bytes]]] = deque()
        with ThreadPoolExecutor(_THREADS) as pool:
            for k in range(last + 1):
                waiting.append(pool.submit(make, k))
                if len(waiting) > ahead:
                    yield take()
            while waiting:
                yield take()


def frame_times(
    motion: RigidMotion, vertices: Matrix, camera: Camera, span: tuple[float, float], samples: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Choose times such that no vertex (V, 3) moves by more than `LARGEST_STEP_PX` between two of them.

    span: begin and end, ns; samples: number of poses looked at, close enough for the image path between two to be
    straight. Returns the times (K + 1,), both ends included, and the bounds (2, 2) of the image: lowest and highest
    u and v. Raises SimulationError when a vertex comes to the camera.
    """
    grid = np.linspace(*span, samples)
    before = None
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    progress = np.zeros(samples)
    for k, t in enumerate(grid):
        R, T = motion.pose(float(t))
        X = vertices @ R.T + T
        if X[:, 2].min() <= 1e-3:
            raise SimulationError(f"the object reaches the camera: a vertex comes to z = {X[:, 2].min():.3f} m")
        uv = camera.project(X)
        low, high = np.minimum(low, uv.min(axis=0)), np.maximum(high, uv.max(axis=0))
        if before is not None:
            progress[k] = np.linalg.norm(uv - before, axis=1).max() / LARGEST_STEP_PX
        before = uv
    steps = np.maximum(progress, (grid[1] - grid[0]) / LONGEST_STEP_NS)
    steps[0] = 0.0
    total = np.cumsum(steps)
    count = max(int(np.ceil(total[-1])), 1)
    return np.interp(np.linspace(0, total[-1], count + 1), total, grid), np.stack([low, high])
