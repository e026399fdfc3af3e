"""Picture of the recent events with the tracks and the image of the spin axis (the screw line, paper section 6.3)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from esfo_core.camera import Camera
from esfo_core.events import EventArray
from esfo_core.orbit import Spin
from esfo_core.tracks import Tracks

BACKGROUND = (24, 24, 28)
COLOURS = np.array([(86, 156, 255), (255, 255, 255)], np.uint8)
"""Off events blue, on events white."""
TRAIL = (60, 170, 80)
HEAD = (120, 255, 120)
LINE = (255, 140, 0)

TRAIL_NS = 150_000_000
"""Time for which the rows of a track are shown."""

_PALETTE = np.vstack([np.array([BACKGROUND], np.uint8), COLOURS])


class Canvas:
    """The latest event of each pixel. levels: (height, width) uint8, 0 without an event, 1 off, 2 on."""

    def __init__(self, width: int, height: int) -> None:
        self.levels = np.zeros((height, width), np.uint8)

    def add(self, events: EventArray) -> None:
        """Draw events (N,), time-sorted and later than those before."""
        self.levels[events["y"], events["x"]] = 1 + events["p"]


class Overlay:
    """One picture of a sensor of width x height px, of the events since the one before it.

    size: (width, height). events: number of them drawn.
    """

    def __init__(self, width: int, height: int, before: Overlay | None = None) -> None:
        """before: the picture before this one, of which the tracks are still seen."""
        self.size = (width, height)
        self.events = 0
        self._canvas = Canvas(width, height)
        self._rows = [] if before is None else [before.trails()]

    def add(self, events: EventArray) -> None:
        """Draw events (N,); the latest of a pixel wins."""
        self.events += len(events)
        self._canvas.add(events)

    def add_tracks(self, rows: Tracks) -> None:
        """Draw the ways of the tracks through these rows, and those before, of the last `TRAIL_NS`."""
        self._rows.append(rows)

    def trails(self) -> Tracks:
        """Return the rows of the last `TRAIL_NS` before the newest one."""
        rows = Tracks.concatenate(self._rows)
        return rows.select(rows.t > rows.t.max(initial=0) - TRAIL_NS)

    def picture(self, line: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Return the picture (height, width, 3), RGB, with the line through the pixels (K, 2)."""
        return compose(self._canvas.levels, self.trails(), line)


def compose(levels: NDArray[np.uint8], rows: Tracks, line: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return the picture (height, width, 3), RGB, of a canvas with tracks and a line through the pixels (K, 2)."""
    picture = _PALETTE[levels]
    draw_tracks(picture, rows)
    draw_line(picture, line)
    return picture


def screw_line(spin: Spin | None, camera: Camera | None) -> NDArray[np.float64]:
    """Return the image of the axis, (K, 2) px; K is 0 while the motion or the camera is unknown."""
    if spin is None or camera is None:
        return np.empty((0, 2))
    return spin.screw_line(camera, half_length=0.5 * float(np.linalg.norm(spin.center)))


def draw_tracks(picture: NDArray[np.uint8], rows: Tracks) -> None:
    """Draw each track as a thin line through its rows with a square of 3 px at the last of them."""
    if not len(rows):
        return
    order = np.lexsort((rows.t, rows.track_id))
    ids, uv = rows.track_id[order], rows.uv[order].astype(np.float64)
    same = ids[1:] == ids[:-1]
    _paint(picture, _pixels(uv[:-1][same], uv[1:][same]), TRAIL)
    heads = np.rint(uv[np.append(~same, True)]).astype(np.int64)
    square = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2)
    _paint(picture, (heads[:, None] + square).reshape(-1, 2), HEAD)


def draw_line(picture: NDArray[np.uint8], line: NDArray[np.float64]) -> None:
    """Draw straight pieces, two pixels wide, between the pixels (K, 2); what lies outside is cut off."""
    height, width, _ = picture.shape
    for start, stop in pairwise(line):
        low, high = _visible(start, stop - start, width, height)
        if low > high:
            continue
        points = _pixels(*(start + s * (stop - start)[None] for s in (low, high)))
        for shift in ((0, 0), (1, 0), (0, 1)):
            _paint(picture, points + shift, LINE)


def _pixels(starts: NDArray[np.float64], stops: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the pixels (N, 2) along straight pieces between (K, 2) and (K, 2), without a gap."""
    step = stops - starts
    steps = np.ceil(np.abs(step).max(axis=1, initial=0.0)).astype(np.int64) + 1
    piece = np.repeat(np.arange(len(steps)), steps)
    place = np.arange(len(piece)) - np.repeat(np.cumsum(steps) - steps, steps)
    s = place / np.maximum(steps - 1, 1)[piece]
    return np.asarray(np.rint(starts[piece] + s[:, None] * step[piece]), np.int64)


def _paint(picture: NDArray[np.uint8], pixels: NDArray[np.int64], colour: tuple[int, int, int]) -> None:
    height, width, _ = picture.shape
    x, y = pixels.T
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    picture[y[inside], x[inside]] = colour


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
