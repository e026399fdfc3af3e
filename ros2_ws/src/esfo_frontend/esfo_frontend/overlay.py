"""Picture of the recent events with the tracks and the image of the spin axis (the screw line, paper section 6.3)."""

from __future__ import annotations

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
        """before: the previous picture, whose tracks are still shown."""
        self.size = (width, height)
        self.events = 0
        self._canvas = Canvas(width, height)
        self._rows = [] if before is None else [before.trails()]

    def add(self, events: EventArray) -> None:
        """Draw events (N,); the latest of a pixel wins."""
        self.events += len(events)
        self._canvas.add(events)

    def add_tracks(self, rows: Tracks) -> None:
        """Draw the paths of the tracks over the last `TRAIL_NS`, with these rows added.

        Rows earlier than that begin a new stream: the paths before are forgotten.
        """
        if len(rows):
            seen = self.trails()
            goes_back = len(seen) and rows.t.max() < seen.t.max() - TRAIL_NS
            self._rows = [rows] if goes_back else [seen, rows]

    def trails(self) -> Tracks:
        """Return the rows of the last `TRAIL_NS` before the newest one."""
        rows = Tracks.concatenate(self._rows)
        return rows.select(rows.t > rows.t.max(initial=0) - TRAIL_NS)

    def picture(self, line: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Return the picture (height, width, 3), RGB, with the line through the pixels (K, 2)."""
        return compose(self._canvas.levels, self.trails(), line_pixels(line, *self.size))


def compose(levels: NDArray[np.uint8], rows: Tracks, line: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Return the picture (height, width, 3), RGB, of a canvas with tracks and the pixels (N, 2) of a line."""
    picture = np.take(_PALETTE, levels, axis=0)  # five times faster than _PALETTE[levels]
    draw_tracks(picture, rows)
    _paint(picture, line, LINE)
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


def line_pixels(line: NDArray[np.float64], width: int, height: int) -> NDArray[np.int64]:
    """Return the pixels (N, 2) of straight pieces, two pixels wide, between the pixels (K, 2), inside of the image."""
    starts, steps = line[:-1], np.diff(line, axis=0)
    low, high = _visible(starts, steps, np.array([width, height]) - 1.0)
    seen = low <= high
    starts, steps, low, high = starts[seen], steps[seen], low[seen, None], high[seen, None]
    thin = np.unique(_pixels(starts + low * steps, starts + high * steps), axis=0)
    pixels = (thin[:, None] + np.array([[0, 0], [1, 0], [0, 1]])).reshape(-1, 2)
    inside = ((pixels >= 0) & (pixels < [width, height])).all(axis=1)
    return np.asarray(pixels[inside], np.int64)


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


def _visible(
    starts: NDArray[np.float64], steps: NDArray[np.float64], last: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Range of s in [0, 1], (K,) and (K,), for which start + s step lies in [0, last]; low > high where none does."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort([-starts / steps, (last - starts) / steps], axis=0)
    within = (starts >= 0) & (starts <= last)
    level = steps == 0.0
    low = np.where(level, np.where(within, 0.0, 1.0), ends[0]).max(axis=1, initial=0.0)
    high = np.where(level, np.where(within, 1.0, 0.0), ends[1]).min(axis=1, initial=1.0)
    return low, high
