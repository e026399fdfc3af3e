"""Picture of the recent events with the image of the spin axis (the screw line, paper section 6.3)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from esfo_core.camera import Camera
from esfo_core.events import EventArray
from esfo_core.orbit import Spin

BACKGROUND = (24, 24, 28)
COLOURS = np.array([(86, 156, 255), (255, 255, 255)], np.uint8)
"""Off events blue, on events white."""
LINE = (255, 140, 0)


class Overlay:
    """One picture of events of a sensor of width x height px. size: (width, height). events: number of them drawn."""

    def __init__(self, width: int, height: int) -> None:
        self.size = (width, height)
        self.events = 0
        self._canvas = np.empty((height, width, 3), np.uint8)
        self._canvas[:] = BACKGROUND

    def add(self, events: EventArray) -> None:
        """Draw events (N,); the latest of a pixel wins."""
        self.events += len(events)
        self._canvas[events["y"], events["x"]] = COLOURS[events["p"]]

    def picture(self, line: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Return the picture (height, width, 3), RGB, with the line through the pixels (K, 2)."""
        picture = self._canvas.copy()
        draw_line(picture, line)
        return picture


def screw_line(spin: Spin | None, camera: Camera | None) -> NDArray[np.float64]:
    """Return the image of the axis, (K, 2) px; K is 0 while the motion or the camera is unknown."""
    if spin is None or camera is None:
        return np.empty((0, 2))
    return spin.screw_line(camera, half_length=0.5 * float(np.linalg.norm(spin.center)))


def draw_line(picture: NDArray[np.uint8], line: NDArray[np.float64]) -> None:
    """Draw straight pieces, two pixels wide, between the pixels (K, 2); what lies outside is cut off."""
    height, width, _ = picture.shape
    for start, stop in pairwise(line):
        low, high = _visible(start, stop - start, width, height)
        if low > high:
            continue
        steps = int(np.ceil((high - low) * np.abs(stop - start).max())) + 1
        points = np.rint(start + np.linspace(low, high, steps)[:, None] * (stop - start)).astype(np.int64)
        for dx, dy in ((0, 0), (1, 0), (0, 1)):
            x, y = points[:, 0] + dx, points[:, 1] + dy
            inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
            picture[y[inside], x[inside]] = LINE


def _visible(start: NDArray[np.float64], step: NDArray[np.float64], width: int, height: int) -> tuple[float, float]:
    """Range of s in [0, 1] for which start + s step lies in the image; empty (low > high) when none does."""
    low, high = 0.0, 1.0
    for p, d, size in zip(start, step, (width, height), strict=True):
        if d == 0.0:
            if not 0 <= p <= size - 1:
                return 1.0, 0.0
            continue
        near, far = sorted((-p / d, (size - 1 - p) / d))
        low, high = max(low, near), min(high, far)
    return low, high
