"""Event counts on a coarse grid of space and time, from which the period is found; a thousandth of the data."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from esfo_core.errors import EsfoError
from esfo_core.events import EventArray


class ActivityError(EsfoError):
    """Pieces of activity do not fit together."""


@dataclass(frozen=True)
class Activity:
    """Event counts per time bin, polarity and cell.

    t0: start of the first bin, ns. bin: length of a bin, ns. cell: edge of a square cell, px.
    counts: (B, 2, rows, columns) uint16, saturating at 65535; polarity 0 is off, 1 is on.
    valid: (B,), False for bins of which nothing is known (lost packets, pauses): they are missing, not dark.
    """

    t0: int
    bin: int
    cell: int
    counts: NDArray[np.uint16]
    valid: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, np.bool_))

    def __post_init__(self) -> None:
        """Take all bins for valid where no mask is given. Raises ActivityError for a mask of another length."""
        if not len(self.valid):
            object.__setattr__(self, "valid", np.ones(len(self.counts), np.bool_))
        if len(self.valid) != len(self.counts):
            raise ActivityError(f"a mask of {len(self.valid)} does not fit {len(self.counts)} bins of activity")

    @property
    def end(self) -> int:
        """Time just after the last bin, ns."""
        return self.t0 + self.bin * len(self.counts)

    @staticmethod
    def from_events(events: EventArray, t0: int, bins: int, bin_ns: int, cell: int, grid: tuple[int, int]) -> Activity:
        """Count events of [t0, t0 + bins * bin_ns) on a grid of (rows, columns) cells; events of other times are not.

        Raises ActivityError for an event outside the grid.
        """
        rows, columns = grid
        k = (events["t"] - t0) // bin_ns
        inside = (k >= 0) & (k < bins)
        chosen, k = events[inside], k[inside]
        y, x = chosen["y"].astype(np.int64) // cell, chosen["x"].astype(np.int64) // cell
        if len(chosen) and (y.max() >= rows or x.max() >= columns):
            raise ActivityError(
                f"event at x = {chosen['x'].max()}, y = {chosen['y'].max()} lies outside "
                f"{columns} x {rows} cells of {cell} px"
            )
        flat = ((k * 2 + chosen["p"]) * rows + y) * columns + x
        counts = np.bincount(flat, minlength=bins * 2 * rows * columns)
        saturated = np.minimum(counts, np.iinfo(np.uint16).max).astype(np.uint16)
        return Activity(t0, bin_ns, cell, saturated.reshape(bins, 2, rows, columns))

    @staticmethod
    def concatenate(parts: Iterable[Activity]) -> Activity:
        """Join pieces that follow one another; bins between two are missing: no counts, not valid.

        Raises ActivityError when the pieces differ in bin, cell or grid, overlap, or there is none.
        """
        pieces = sorted(parts, key=lambda a: a.t0)
        if not pieces:
            raise ActivityError("no activity to join")
        first = pieces[0]
        for piece in pieces[1:]:
            if (piece.bin, piece.cell, piece.counts.shape[1:]) != (first.bin, first.cell, first.counts.shape[1:]):
                raise ActivityError(
                    f"activity of bin {piece.bin} ns, cell {piece.cell} px, grid {piece.counts.shape[2:]} does not fit "
                    f"bin {first.bin} ns, cell {first.cell} px, grid {first.counts.shape[2:]}"
                )
        total = (max(piece.end for piece in pieces) - first.t0) // first.bin
        counts = np.zeros((total, *first.counts.shape[1:]), np.uint16)
        valid = np.zeros(total, np.bool_)
        covered = 0
        for piece in pieces:
            start, rest = divmod(piece.t0 - first.t0, first.bin)
            if rest or start < covered:
                raise ActivityError(f"activity at {piece.t0} ns overlaps or is not aligned with bins of {first.bin} ns")
            covered = start + len(piece.counts)
            counts[start:covered], valid[start:covered] = piece.counts, piece.valid
        return Activity(first.t0, first.bin, first.cell, counts, valid)

    def known(self) -> Iterator[Activity]:
        """Yield the stretches without a missing bin."""
        edges = np.flatnonzero(np.diff(np.concatenate([[False], self.valid, [False]])))
        for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            yield self.part(begin, end)

    def part(self, start: int, stop: int | None = None) -> Activity:
        """Bins start:stop, as views."""
        start = range(len(self.counts))[start:].start
        t0 = self.t0 + start * self.bin
        return Activity(t0, self.bin, self.cell, self.counts[start:stop], self.valid[start:stop])
