"""Activity at many resolutions in bounded memory, so that a period of any length can be looked for.

Level k has bins of FINEST_BIN * 4**k ns, at absolute multiples of their width, and room for WINDOW of them. A coarse
level holds the whole stream; a fine one holds two windows of it: the one with the most events, and the one of now.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from esfo_core.activity import Activity, ActivityError

FINEST_BIN = 4_000
"""ns; a thousandth of a turn at 250 Hz. Sensors give times in steps of 1 us and read out in bursts of about as much."""
FACTOR = 4
LEVELS = 12
"""The coarsest bin is 16.8 s, of which a window is 19 hours."""
WINDOW = 4096
BINS = tuple(FINEST_BIN * FACTOR**k for k in range(LEVELS))


class _Window:
    """Counts of up to WINDOW bins from bin number `start` on; `used`: bins up to the latest; events: their number."""

    def __init__(self, start: int, grid: tuple[int, ...]) -> None:
        self.start, self.used, self.events = start, 0, 0
        self.counts = np.zeros((WINDOW, *grid), np.uint16)
        self.valid = np.zeros(WINDOW, np.bool_)

    def restart(self, start: int) -> None:
        self.counts[: self.used] = 0
        self.valid[: self.used] = False
        self.start, self.used, self.events = start, 0, 0


class Level:
    """One resolution, from pieces of its activity in order of time."""

    def __init__(self, bin_ns: int, cell: int, grid: tuple[int, ...]) -> None:
        self.bin, self.cell, self._grid = bin_ns, cell, grid
        self._now: _Window | None = None
        self._most: _Window | None = None

    def fits(self, piece: Activity) -> bool:
        """Whether a piece has the cells of this level."""
        return piece.cell == self.cell and piece.counts.shape[1:] == self._grid

    def add(self, piece: Activity) -> None:
        """Take in counts; bins between the pieces are missing. Raises ActivityError for a piece off the bins."""
        if piece.t0 % self.bin:
            raise ActivityError(f"activity at {piece.t0} ns is not aligned with bins of {self.bin} ns")
        for known in piece.known():  # as messages bring it, so that windows begin at the same bins
            self._add_known(known)

    def _add_known(self, piece: Activity) -> None:
        first = piece.t0 // self.bin
        done = 0
        while done < len(piece.counts):
            window = self._window_at(first + done)
            at = first + done - window.start
            n = min(WINDOW - at, len(piece.counts) - done)
            part = piece.part(done, done + n)
            window.counts[at : at + n] = part.counts
            window.valid[at : at + n] = part.valid
            window.used = max(window.used, at + n)
            window.events += int(part.counts.sum(dtype=np.int64))
            done += n

    def _window_at(self, number: int) -> _Window:
        if self._now is None:
            self._now = _Window(number, self._grid)
        elif not 0 <= number - self._now.start < WINDOW:
            full, spare = self._now, self._most
            if spare is None or full.events >= spare.events:
                self._most, full = full, spare or _Window(number, self._grid)
            full.restart(number)
            self._now = full
        return self._now

    def windows(self) -> list[Activity]:
        """The window with the most events, then the other one, where there are two."""
        held = [w for w in (self._most, self._now) if w is not None and w.used]
        return [
            Activity(w.start * self.bin, self.bin, self.cell, w.counts[: w.used].copy(), w.valid[: w.used].copy())
            for w in sorted(held, key=lambda w: -w.events)
        ]


class ActivityPyramid:
    """Activity at all resolutions, from the pieces that `PyramidCounter` makes of events, in any order of levels.

    Pieces of other cells begin the pyramid anew: the region of the image that is counted has changed, and the counter
    sends again what it holds.
    """

    def __init__(self) -> None:
        self._levels: dict[int, Level] = {}

    def add(self, pieces: Iterable[Activity]) -> None:
        """Take in pieces. Raises ActivityError for one that is none of a pyramid."""
        for piece in pieces:
            if piece.bin not in BINS:
                raise ActivityError(f"bins of {piece.bin} ns are none of a pyramid: {', '.join(map(str, BINS))}")
            if self._levels and not next(iter(self._levels.values())).fits(piece):
                self._levels = {}
            if piece.bin not in self._levels:
                self._levels[piece.bin] = Level(piece.bin, piece.cell, piece.counts.shape[1:])
            self._levels[piece.bin].add(piece)

    def levels(self) -> list[Activity]:
        """The window with the most events of each level, finest level first."""
        held = [self._levels[b].windows() for b in sorted(self._levels)]
        return [windows[0] for windows in held if windows]

    @property
    def nbytes(self) -> int:
        """Memory of the counts, bytes."""
        return sum(w.counts.nbytes for level in self._levels.values() for w in level.windows())
