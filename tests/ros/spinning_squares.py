"""A small scene for the nodes: bright squares on a spinning drum, rendered frame by frame, with the truth."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from esfo_core.camera import Camera
from esfo_core.events import EventArray, make_events
from esfo_core.orbit import Spin, object_frame, rotation

MS = 1_000_000
CAMERA = Camera.pinhole(240, 180, 240.0)
_AXIS = np.array([0.15, -0.95, 0.25])
SPIN = Spin(_AXIS / np.linalg.norm(_AXIS), 1.0, np.array([0.02, 0.0, 1.0]), 1_000 * MS)


def events(duration_s: float, seed: int = 5) -> Iterator[EventArray]:
    """Yield the events of each millisecond: one for every pixel that changes between two frames."""
    rng = np.random.default_rng(seed)
    squares = _squares(rng)
    before = _image(squares, SPIN.t0)
    for k in range(1, round(duration_s * 1000)):
        t = SPIN.t0 + k * MS
        image = _image(squares, t)
        y, x = np.nonzero(image != before)
        order = rng.permutation(len(x))
        times = t - MS + np.arange(len(x)) * MS // max(len(x), 1)
        if len(x):
            yield make_events(x[order], y[order], image[y, x][order].astype(np.int8), times)
        before = image


def _squares(rng: np.random.Generator) -> NDArray[np.float64]:
    """Corners (S, 4, 3) of squares on a drum about the spin axis, in the object's coordinates at t0."""
    n = 28
    angle = np.arange(n) * 2 * np.pi / n * 5 + rng.uniform(-0.06, 0.06, n)
    height = np.linspace(-0.24, 0.24, n) + rng.uniform(-0.02, 0.02, n)
    radius = rng.uniform(0.22, 0.3, n)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    side = np.stack([-np.sin(angle), np.cos(angle), np.zeros(n)], axis=1)
    along = np.array([0.0, 0.0, 1.0])
    center = radius[:, None] * out + height[:, None] * along
    half = 0.035
    corners = [center + half * (a * side + b * along) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return np.stack(corners, axis=1) @ object_frame(SPIN.axis).T


def _image(squares: NDArray[np.float64], t: int) -> NDArray[np.bool_]:
    """Draw the squares that face the camera: those whose corners run clockwise in the image (y down)."""
    R = rotation(SPIN.axis, float(SPIN.angle(np.asarray(t))))
    uv = CAMERA.project((squares @ R.T + SPIN.center).reshape(-1, 3)).reshape(-1, 4, 2)
    image = np.zeros((CAMERA.height, CAMERA.width), bool)
    for corners in uv:
        edges = np.roll(corners, -1, axis=0) - corners
        turn = edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0]
        x0, y0 = np.maximum(np.floor(corners.min(axis=0)).astype(int), 0)
        x1, y1 = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 1, (CAMERA.width, CAMERA.height))
        if turn >= 0 or x0 >= x1 or y0 >= y1:
            continue
        y, x = np.mgrid[y0:y1, x0:x1]
        inside = np.ones(x.shape, bool)
        for (cx, cy), (ex, ey) in zip(corners, edges, strict=True):
            inside &= ex * (y - cy) - ey * (x - cx) <= 0
        image[y0:y1, x0:x1] |= inside
    return image
