"""The part of the image where the events are, in square cells that fit its size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SMALLEST_CELL = 2
"""px. Corners and noise blur what is smaller."""
_CELLS = 10
"""Cells along the longer side: fewer blur the image, more have too few events each."""
_MOST_CELLS = 14
"""Cells along the longer side of a region that has grown, before they are merged."""
_SHARE = 0.01
"""Share of the events that may lie beyond each side: noise is everywhere."""
_BANDS, _EMPTY = 32, 0.1
"""Bands of rows or columns, of which this share at least sees nothing but noise, or little of the object."""
_CHANCE = 0.05
"""Events in a band, relative to the mean of all bands, that are no object."""
_MARGIN = 0.1


@dataclass(frozen=True)
class Region:
    """Cells of `cell` px; row, column: of the first, counted from the corner of the image; rows, columns: number."""

    cell: int
    row: int
    column: int
    rows: int
    columns: int

    @property
    def longer(self) -> int:
        """Longer side, px."""
        return max(self.rows, self.columns) * self.cell

    def holds(self, box: tuple[int, int, int, int]) -> bool:
        """Whether pixels of a box (first x, last x, first y, last y) lie in the region."""
        x0, x1, y0, y1 = (v // self.cell for v in box)
        return self.column <= x0 and x1 < self.column + self.columns and self.row <= y0 and (y1 < self.row + self.rows)


def box_of(x: NDArray[np.int64], y: NDArray[np.int64]) -> tuple[int, int, int, int]:
    """First and last x and y of most events, from the numbers of events per column x (W,) and per row y (H,)."""
    edges = []
    for count in (x, y):
        share = np.cumsum(_above_noise(count))
        share = share / share[-1] if share[-1] > 0 else np.linspace(0, 1, len(count))
        edges += [int(np.searchsorted(share, _SHARE)), int(np.searchsorted(share, 1 - _SHARE))]
    return edges[0], edges[1], edges[2], edges[3]


def _above_noise(count: NDArray[np.int64]) -> NDArray[np.float64]:
    """Events per line of the image beyond those that every line has: the noise of a sensor is everywhere."""
    first = np.unique(np.linspace(0, len(count), _BANDS + 1).astype(np.int64))[:-1]
    lines = np.diff(np.append(first, len(count)))
    total = np.add.reduceat(count, first).astype(np.float64)
    noise = float(np.quantile(total / lines, _EMPTY))
    expected = noise * lines
    stands_out = total > expected + 3 * np.sqrt(expected) + _CHANCE * count.sum() / len(first)
    return np.where(np.repeat(stands_out, lines), np.maximum(count - noise, 0.0), 0.0)


def region_about(box: tuple[int, int, int, int], width: int, height: int) -> Region:
    """Region with a margin about a box, in a sensor of width x height px."""
    x0, x1, y0, y1 = box
    longer = max(x1 - x0, y1 - y0) + 1
    cell = SMALLEST_CELL
    while longer > _CELLS * cell:
        cell *= 2
    margin = round(_MARGIN * longer)
    first = max(x0 - margin, 0) // cell, max(y0 - margin, 0) // cell
    last = min(x1 + margin, width - 1) // cell, min(y1 + margin, height - 1) // cell
    return Region(cell, first[1], first[0], last[1] - first[1] + 1, last[0] - first[0] + 1)


def union(a: Region, b: Region) -> Region:
    """Smallest region that holds two, in the cells of the first, or larger ones where it takes too many."""
    cell = a.cell
    while True:
        row, column = min(r.row * r.cell for r in (a, b)) // cell, min(r.column * r.cell for r in (a, b)) // cell
        rows = -(-max((r.row + r.rows) * r.cell for r in (a, b)) // cell) - row
        columns = -(-max((r.column + r.columns) * r.cell for r in (a, b)) // cell) - column
        if max(rows, columns) <= _MOST_CELLS:
            return Region(cell, row, column, rows, columns)
        cell *= 2


def moved(counts: NDArray[np.uint16], old: Region, new: Region) -> NDArray[np.uint16]:
    """Counts (B, 2, rows, columns) of one region as those of another that holds it, in equal or larger cells."""
    factor = new.cell // old.cell
    top, left = old.row - new.row * factor, old.column - new.column * factor
    wide = np.zeros((len(counts), 2, new.rows * factor, new.columns * factor), np.uint32)
    wide[:, :, top : top + old.rows, left : left + old.columns] = counts
    summed = wide.reshape(len(counts), 2, new.rows, factor, new.columns, factor).sum(axis=(3, 5))
    merged: NDArray[np.uint16] = np.minimum(summed, np.iinfo(np.uint16).max).astype(np.uint16)
    return merged


def summed(seen: NDArray[np.int64], region: Region) -> NDArray[np.int64]:
    """Sums per cell of a region (2, rows, columns) of a histogram of the image in the smallest cells."""
    step = region.cell // SMALLEST_CELL
    top, left = region.row * step, region.column * step
    rows, columns = region.rows * step, region.columns * step
    part = seen[:, top : top + rows, left : left + columns]
    full = np.pad(part, ((0, 0), (0, rows - part.shape[1]), (0, columns - part.shape[2])))
    return np.asarray(full.reshape(2, region.rows, step, region.columns, step).sum(axis=(2, 4)))
