"""Rendering: a model in any pose as a quantised log-intensity image.

A depth-buffered rasteriser on a grid twice as fine as the sensor, then an optical blur. Each sub-step is a small
compiled loop without the interpreter lock, so that frames can be rendered in threads.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.camera import Camera
from esfo_core.simulation.surface import Model

OVERSAMPLING = 2
_HIGHEST = 65535
# Reach of the blur on each side in sensor pixels: beyond it a Gaussian of 0.65 px weighs less than 1e-5.
BLUR_REACH = 3


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


@njit(cache=True, nogil=True)
def rasterize(uv, inverse_depth, faces, shade, image, depth):  # type: ignore[no-untyped-def]
    """Draw triangles into image, keeping what is nearest.

    uv: (V, 2) positions in pixels of the image, whose sample points are the integers; inverse_depth: (V,) 1/z, which is
    linear over the image of a plane; faces: (F, 3); shade: (F,) radiance. image, depth: (H, W), changed in place; depth
    holds 1/z, 0 where empty. Triangles that turn away from the camera are skipped.
    """
    height, width = image.shape
    for f in range(len(faces)):
        ia, ib, ic = faces[f]
        ax, ay, bx, by, cx, cy = uv[ia, 0], uv[ia, 1], uv[ib, 0], uv[ib, 1], uv[ic, 0], uv[ic, 1]
        # y points down: a triangle that is counter-clockwise seen from outside has negative area here.
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area >= 0.0:
            continue
        x0, x1 = max(int(np.ceil(min(ax, bx, cx))), 0), min(int(np.floor(max(ax, bx, cx))), width - 1)
        y0, y1 = max(int(np.ceil(min(ay, by, cy))), 0), min(int(np.floor(max(ay, by, cy))), height - 1)
        za, zb, zc = inverse_depth[ia], inverse_depth[ib], inverse_depth[ic]
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                wa = (bx - x) * (cy - y) - (by - y) * (cx - x)
                wb = (cx - x) * (ay - y) - (cy - y) * (ax - x)
                wc = (ax - x) * (by - y) - (ay - y) * (bx - x)
                if wa > 0.0 or wb > 0.0 or wc > 0.0:
                    continue
                z = (wa * za + wb * zb + wc * zc) / area
                if z > depth[y, x]:
                    depth[y, x] = z
                    image[y, x] = shade[f]


@njit(cache=True, nogil=True)
def reduce_rows(fine, taps, out):  # type: ignore[no-untyped-def]
    """Blur and halve along the first axis: out[i] = sum_k taps[k] fine[2 i + k]."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = 0.0
        for k in range(len(taps)):
            for j in range(out.shape[1]):
                out[i, j] += taps[k] * fine[OVERSAMPLING * i + k, j]


@njit(cache=True, nogil=True)
def reduce_columns(fine, taps, out):  # type: ignore[no-untyped-def]
    """Blur and halve along the second axis: out[:, j] = sum_k taps[k] fine[:, 2 j + k]."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            total = 0.0
            for k in range(len(taps)):
                total += taps[k] * fine[i, OVERSAMPLING * j + k]
            out[i, j] = total


@njit(cache=True, nogil=True)
def quantize(radiance, low, step, out):  # type: ignore[no-untyped-def]
    """Store log radiance as whole steps above `low`: out = round((log(radiance) - low) / step)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = np.uint16((np.log(radiance[i, j]) - low) / step + 0.5)


class Renderer:
    """Renders the model in any pose.

    window: what to render; the model must stay inside it. blur_px: standard deviation of the optical blur. The steps of
    `levels` are finer than 1e-4, far below any contrast threshold.
    """

    def __init__(self, model: Model, camera: Camera, window: Window, light: Light, blur_px: float) -> None:
        self._model, self._camera, self._window, self._light = model, camera, window, light
        self._normals = model.normals()
        brightest = max(float(model.albedo.max()) * (light.ambient + light.diffuse), light.background)
        darkest = min(float(model.albedo.min()) * light.ambient, light.background)
        low = float(np.log(darkest)) - 1e-3
        self.levels = Levels(low, (float(np.log(brightest)) + 1e-3 - low) / _HIGHEST)
        offset = np.arange(-OVERSAMPLING * BLUR_REACH, OVERSAMPLING * (BLUR_REACH + 1)) + 0.5 - OVERSAMPLING / 2
        weights = np.exp(-0.5 * (offset / (OVERSAMPLING * blur_px)) ** 2)
        self._taps = weights / weights.sum()

    def render(self, R: NDArray[np.float64], T: NDArray[np.float64]) -> NDArray[np.uint16]:
        """Return the quantised log radiance (height, width) of the window, with the model's points X at R X + T.

        R: (3, 3), T: (3,) metres, from the model's coordinates to the camera's optical frame.
        """
        X = self._model.vertices @ R.T + T
        facing = np.maximum(self._normals @ (R.T @ np.array(self._light.direction)), 0.0)
        shade = self._model.albedo * (self._light.ambient + self._light.diffuse * facing)
        # Fine sample k lies at sensor position first + (k - fine_margin + 0.5) / 2 - 0.5.
        margin = OVERSAMPLING * BLUR_REACH
        first = np.array([self._window.x, self._window.y])
        uv = (self._camera.project(X) - first + 0.5) * OVERSAMPLING - 0.5 + margin
        shape = (OVERSAMPLING * self._window.height + 2 * margin, OVERSAMPLING * self._window.width + 2 * margin)
        image = np.full(shape, self._light.background, np.float32)
        rasterize(uv, 1.0 / X[:, 2], self._model.faces, shade.astype(np.float32), image, np.zeros(shape, np.float64))
        rows = np.empty((self._window.height, shape[1]), np.float32)
        reduce_rows(image, self._taps.astype(np.float32), rows)
        radiance = np.empty((self._window.height, self._window.width), np.float32)
        reduce_columns(rows, self._taps.astype(np.float32), radiance)
        out = np.empty(radiance.shape, np.uint16)
        quantize(radiance, self.levels.low, self.levels.step, out)
        return out
