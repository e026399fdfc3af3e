"""Rendering: a model in any pose as a quantised log-intensity image.

The faces are cut and halved until the lens bends none of them (tessellation), drawn with a depth buffer on a grid twice
as fine as the sensor (rasterizer), their borders put into place (borders), then blurred and stored as whole steps of
log radiance (exposure). Each is a few compiled loops without the interpreter lock, so that threads can share the work.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from esfo_core.camera import Camera
from esfo_core.errors import SimulationError
from esfo_simulation.render.borders import gather
from esfo_simulation.render.exposure import OVERSAMPLING, blur_taps, develop, whole_steps
from esfo_simulation.render.rasterizer import PLANE, rasterize
from esfo_simulation.render.surface import Model
from esfo_simulation.render.tessellation import CHORD_ERROR_PX, field_of, neighbours, tessellate

BLUR_REACH = 3
"""Reach of the blur on each side in sensor pixels, for a margin: a Gaussian of 0.65 px weighs less than 1e-5 beyond."""

_HIGHEST = 65535
_LEAST_BLUR_PX = 0.15


@dataclass(frozen=True)
class Light:
    """Illumination: a distant source (unit vector towards it, camera frame), its parts and the background radiance."""

    direction: tuple[float, float, float] = (-0.48, -0.64, -0.6)
    ambient: float = 0.5
    diffuse: float = 0.5
    background: float = 0.22


@dataclass(frozen=True)
class Levels:
    """What the numbers of a frame mean: level k is a log radiance of low + k step."""

    low: float
    step: float

    def log_radiance(self, frame: NDArray[np.uint16]) -> NDArray[np.float64]:
        """Return the log radiance of a frame (H, W)."""
        return np.asarray(frame * self.step + self.low)


@dataclass(frozen=True)
class Window:
    """Part of the sensor that the model ever covers: first column and row, width and height in pixels."""

    x: int
    y: int
    width: int
    height: int


class _Scratch(threading.local):
    """Buffers of one thread; every frame leaves them as it found them. margin: samples around the window."""

    def __init__(self, window: Window, margin: int, background: float, faces: int) -> None:
        height, width = OVERSAMPLING * window.height + 2 * margin, OVERSAMPLING * window.width + 2 * margin
        self.ids, self.depth = np.zeros((height, width), np.int32), np.zeros((height, width), np.float32)
        self.extent = np.tile(np.array([width, -1]), (height, 1))
        self.rows = np.full((height, window.width), background, np.float32)
        self.parts = np.zeros((faces, 3), np.int32)
        self.reserve(0)

    def reserve(self, triangles: int) -> None:
        """Make room for so many triangles; what was stored is lost."""
        self.corners = np.empty((triangles, 3, 4))
        self.planes = np.zeros((triangles + 1, PLANE))


class Renderer:
    """Renders the model in any pose, in any number of threads.

    window: the part of the sensor to render. The model may leave it, and come up to the camera: what is nearer than
    1 mm is not drawn. blur_px: standard deviation of the optical blur, at least 0.15. Parts thinner than half a pixel
    may be seen in pieces.

    The steps of `levels` are finer than 1e-4, far below any contrast threshold. Raises SimulationError for too small a
    blur.
    """

    def __init__(self, model: Model, camera: Camera, window: Window, light: Light, blur_px: float) -> None:
        if not blur_px >= _LEAST_BLUR_PX:
            raise SimulationError(f"a blur of {blur_px} px is less than what samples half a pixel apart can show, 0.15")
        self._model, self._camera, self._window, self._light = model, camera, window, light
        with np.errstate(invalid="ignore"):  # a face without area has no normal; it is never seen
            self._normals = model.normals()
        self._neighbours = neighbours(model)
        brightest = max(float(model.albedo.max()) * (light.ambient + light.diffuse), light.background)
        darkest = min(float(model.albedo.min()) * light.ambient, light.background)
        low = float(np.log(darkest)) - 1e-3
        self.levels = Levels(low, (float(np.log(brightest)) + 1e-3 - low) / _HIGHEST)
        self._taps = blur_taps(blur_px)
        self._margin = len(self._taps) // 2 - 1
        self._scratch = _Scratch(window, self._margin, light.background, len(model.faces))
        reach = self._margin / OVERSAMPLING + 1
        corner, size = np.array([window.x, window.y]), np.array([window.width, window.height])
        self._field = field_of(camera, corner - reach, corner + size + reach)
        self._background = np.empty(1, np.uint16)
        whole_steps(np.full(1, light.background, np.float32), *self._steps, np.empty(1, np.int32), self._background)

    @property
    def _steps(self) -> tuple[float, float]:
        return self.levels.low, self.levels.step

    def render(self, R: NDArray[np.float64], T: NDArray[np.float64]) -> NDArray[np.uint16]:
        """Return the quantised log radiance (height, width) of the window, with the model's points X at R X + T.

        R: (3, 3), T: (3,) metres, from the model's coordinates to the camera's optical frame.
        """
        buffers, window = self._scratch, self._window
        count = self._tessellate(buffers, self._model.vertices @ R.T + T)
        corners, planes = buffers.corners[:count], buffers.planes[: count + 1]
        self._to_samples(corners)
        facing = np.maximum(self._normals @ (R.T @ np.array(self._light.direction)), 0.0)
        shade = self._model.albedo * (self._light.ambient + self._light.diffuse * facing)
        face_of = np.concatenate([[0], np.repeat(np.arange(len(shade)), buffers.parts[:, 1] - buffers.parts[:, 0])])
        radiance = shade[face_of].astype(np.float32)
        radiance[0] = self._light.background

        rasterize(corners, planes, buffers.ids, buffers.depth, buffers.extent)
        samples = (buffers.ids, buffers.depth, buffers.extent)
        surfaces = (planes, face_of, buffers.parts, self._neighbours)
        gather(samples, surfaces, radiance, self._taps, buffers.rows)
        out = np.full((window.height, window.width), self._background, np.uint16)
        develop(buffers.rows, buffers.extent, self._taps, (*self._steps, radiance[0]), out)
        return out

    def _tessellate(self, buffers: _Scratch, X: NDArray[np.float64]) -> int:
        """Fill `corners` and `parts`; return the number of triangles."""
        field = self._field
        tolerance = CHORD_ERROR_PX if np.isfinite(field.radius) else np.inf
        lens = (field.bending, field.bins, tolerance)
        arguments = (X, self._model.faces, (field.normals, field.radius), lens)
        count = int(tessellate(*arguments, buffers.corners, buffers.parts))
        if count > len(buffers.corners):
            buffers.reserve(count + count // 4)
            count = int(tessellate(*arguments, buffers.corners, buffers.parts))
        return count

    def _to_samples(self, corners: NDArray[np.float64]) -> None:
        """Take x and y on the plane z = 1 to sample coordinates, in place, shape (M, 3, 4)."""
        xy = self._camera.distort(corners[:, :, :2].reshape(-1, 2)).reshape(-1, 3, 2)
        K, first = self._camera.K, np.array([self._window.x, self._window.y])
        # Sample k lies at sensor position first + (k - margin + 0.5) / 2 - 0.5.
        scale = OVERSAMPLING * np.array([K[0, 0], K[1, 1]])
        corners[:, :, :2] = xy * scale + (OVERSAMPLING * (K[:2, 2] - first + 0.5) - 0.5 + self._margin)
