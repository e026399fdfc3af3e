"""Counts events at all resolutions of an activity pyramid as they stream, and gives the counts out in pieces.

Coarse levels are given out bin by bin. Of fine ones, whose bins would be more data than the events, the first window
is, and later ones that have many more events or come long after the one before.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.activity import Activity
from esfo_core.activity_pyramid import BINS, WINDOW
from esfo_core.events import EventArray
from esfo_core.image_region import SMALLEST_CELL, Region, box_of, moved, region_about, summed, union

FIRST_EVENTS = 2000
"""Events from which the region of the image is taken first; it is looked at again whenever they have doubled."""
_SHRINKS_UNTIL = 64_000
"""Events after which the region only grows: it cannot get finer cells without forgetting what was counted."""
_CONTINUOUS = 1_000_000
"""ns. Bins from this length on are given out without a gap: below half a megabyte per second together."""
_MORE = 1.5
"""Ratio of events at which a later window of a fine level replaces the one given out before."""
_REST = 16
"""Windows after which one of a fine level is given out if it has half as many events as the best."""
_FEWEST, _FEWEST_FINE = 8, 64
"""Bins of coarse and of fine levels that are given out together: a message costs more than its counts."""
_KNOWN = 0.5
"""Share of a bin that must have been seen; its counts are scaled by it."""


class _LevelCounter:
    """Counts of one window; `sent`: bins of it given out, `sent_events`: most events of a window given out."""

    def __init__(self, bin_ns: int, region: Region) -> None:
        self.bin = bin_ns
        self.start: int | None = None
        self.sent = self.sent_events = self.events = 0
        self.sent_start: int | None = None
        self.counts = np.zeros((WINDOW, 2, region.rows, region.columns), np.uint16)
        self.missing = np.zeros(WINDOW)
        self.region = region

    def resize(self, region: Region, per_ns: NDArray[np.float64], now: int) -> None:
        """Go on with another region: on a coarse level with what was counted, on a fine one anew.

        per_ns (2, rows, columns): events per ns that cells had so far outside of the old region; now: time, ns. They
        are spread evenly over the past, otherwise the cells would seem to have been dark.
        """
        if self.start is not None and self.bin >= _CONTINUOUS:
            self.counts = moved(self.counts, self.region, region)
            used = min(now // self.bin - self.start + 1, WINDOW)
            share = (self.bin * per_ns).astype(np.float32)
            bins = np.arange(used, dtype=np.float32)[:, None, None, None]
            evenly = (np.floor((bins + 1) * share) - np.floor(bins * share)).astype(np.uint16)
            self.counts[:used] = np.maximum(self.counts[:used] + evenly, self.counts[:used])
        else:
            self.counts = np.zeros((WINDOW, 2, region.rows, region.columns), np.uint16)
            self.start, self.events = None, 0
        self.region = region
        self.sent = self.sent_events = 0
        self.sent_start = None

    @property
    def end(self) -> int:
        """Time of the end of the window, ns."""
        return ((self.start or 0) + WINDOW) * self.bin

    @property
    def streams(self) -> bool:
        """Whether the window is given out while it is counted."""
        return self.bin >= _CONTINUOUS or self.sent_start in (None, self.start)

    def wants(self, events: int, start: int) -> bool:
        """Whether a window that begins at bin `start` is to be given out."""
        if self.bin >= _CONTINUOUS or self.sent_start is None:
            return True
        late = start - self.sent_start >= _REST * WINDOW
        return events > (0.5 if late else _MORE) * self.sent_events

    def begin(self, start: int) -> None:
        self.counts[:] = 0
        self.missing[:] = 0.0
        self.start, self.sent, self.events = start, 0, 0

    def miss(self, begin: int, end: int) -> None:
        """Note that nothing is known of [begin, end) ns."""
        if self.start is None or begin >= self.end:
            return
        first = max(begin // self.bin - self.start, 0)
        last = min((end - 1) // self.bin - self.start, WINDOW - 1)
        edges = np.clip((self.start + np.arange(first, last + 2)) * self.bin, begin, end)
        self.missing[first : last + 1] += (edges[1:] - edges[:-1]).astype(np.float64)

    def give(self, until: int) -> list[Activity]:
        """Bins not given out before, up to number `until` of the window."""
        until = min(until, WINDOW)
        if self.start is None or until <= self.sent:
            return []
        bins = slice(self.sent, until)
        known = np.clip(1 - self.missing[bins] / self.bin, 0.0, 1.0)
        counts, valid = self.counts[bins].copy(), known >= _KNOWN
        partly = valid & (known < 1)
        scaled = np.round(counts[partly] / known[partly, None, None, None])
        counts[partly] = np.minimum(scaled, np.iinfo(np.uint16).max)
        counts[~valid] = 0
        piece = Activity((self.start + self.sent) * self.bin, self.bin, self.region.cell, counts, valid)
        self.sent, self.sent_start = until, self.start
        self.sent_events = max(self.sent_events, self.events)
        return [piece]


class PyramidCounter:
    """Counts the events of one stream from a sensor of width x height px; other packets give the same counts."""

    def __init__(self, width: int, height: int) -> None:
        self._size = (width, height)
        self._x, self._y = np.zeros(width, np.int64), np.zeros(height, np.int64)
        self._seen = np.zeros((2, -(-height // SMALLEST_CELL), -(-width // SMALLEST_CELL)), np.int64)
        self._first = self._checked = 0
        self._seen_then = self._seen.copy()
        self._total, self._check_at = 0, FIRST_EVENTS
        self._waiting: list[EventArray] = []
        self._gaps: list[tuple[int, int]] = []
        self._region: Region | None = None
        self._levels: list[_LevelCounter] = []
        self._pieces: list[Activity] = []
        self._last: int | None = None

    def add(self, events: EventArray) -> None:
        """Take in events (N,) in order of time that follow the earlier ones."""
        while len(events):
            n = min(len(events), self._check_at - self._total)
            self._take_in(events[:n])
            now, events = int(events["t"][n - 1]), events[n:]
            if self._total == self._check_at:
                self._check_at *= 2
                self._look_again()
                self._seen_then, self._checked = self._seen.copy(), now

    def miss(self, begin: int, end: int) -> None:
        """Note that events of [begin, end) ns are missing. Told after the events before it, before those after it."""
        if self._region is None:
            self._gaps.append((begin, end))
        for level in self._levels:
            level.miss(begin, end)

    def take(self) -> list[Activity]:
        """Return the pieces not returned before: bins that are complete, some of them at a time."""
        if self._last is not None:
            for level in self._levels:
                if level.streams and level.start is not None:
                    until = self._last // level.bin - level.start
                    if until - level.sent >= (_FEWEST if level.bin >= _CONTINUOUS else _FEWEST_FINE):
                        self._pieces += level.give(until)
        pieces, self._pieces = self._pieces, []
        return pieces

    def finish(self) -> None:
        """Complete the last bins although the stream may have ended within them."""
        if self._region is None and self._total:
            self._look_again()
        if self._last is None:
            return
        for level in self._levels:
            if level.start is not None and (level.streams or level.wants(level.events, level.start)):
                level.miss(self._last + 1, (self._last // level.bin + 1) * level.bin)
                self._pieces += level.give(self._last // level.bin - level.start + 1)

    def _take_in(self, events: EventArray) -> None:
        self._first = int(events["t"][0]) if self._total == 0 else self._first
        self._total += len(events)
        _see(self._seen, events["x"], events["y"], events["p"])
        self._x += np.bincount(events["x"], minlength=len(self._x))
        self._y += np.bincount(events["y"], minlength=len(self._y))
        if self._region is None:
            self._waiting.append(events.copy())
        else:
            self._count(events)

    def _look_again(self) -> None:
        """Choose the region, or let it grow, by all events so far."""
        box = box_of(self._x, self._y)
        wanted, region = region_about(box, *self._size), self._region
        if region is None:
            self._restart(wanted)
            for events in self._waiting:
                self._count(events)
            self._waiting = []
        elif self._total <= _SHRINKS_UNTIL and 2 * wanted.longer < region.longer:
            self._restart(wanted)
        elif not region.holds(box):
            self._grow(region, union(region, wanted))

    def _grow(self, old: Region, new: Region) -> None:
        """Count a larger region, of which the part outside of the old one has not been counted so far.

        What was seen there until the look before is taken for noise; later events may be of what made it grow.
        """
        now = self._last or self._first
        outside = self._seen_then.copy()
        step = old.cell // SMALLEST_CELL
        top, left = old.row * step, old.column * step
        outside[:, top : top + old.rows * step, left : left + old.columns * step] = 0
        per_ns = summed(outside, new) / max(self._checked - self._first, 1)
        for level in self._levels:
            level.resize(new, per_ns, now)
        self._region, self._pieces = new, []

    def _restart(self, region: Region) -> None:
        self._region, self._pieces = region, []
        self._levels = [_LevelCounter(b, region) for b in BINS]

    def _count(self, events: EventArray) -> None:
        region = self._region
        if region is None or not len(events):
            return
        t = np.ascontiguousarray(events["t"])
        cells = _cells(events["x"], events["y"], events["p"], _fields(region))
        for level in self._levels:
            self._count_level(level, t, cells)
        self._last = int(t[-1])

    def _count_level(self, level: _LevelCounter, t: NDArray[np.int64], cells: NDArray[np.int32]) -> None:
        at = 0
        while at < len(t):
            number = int(t[at]) // level.bin
            if level.start is None or t[at] >= level.end:
                if level.start is not None and (level.streams or level.wants(level.events, level.start)):
                    self._pieces += level.give(WINDOW)
                until = int(np.searchsorted(t, (number + WINDOW) * level.bin))
                if until < len(t) and level.start is not None and not level.wants(until - at, number):
                    level.start, level.sent, level.events = number, WINDOW, 0  # over already, and not to be given out
                    at = until
                    continue
                level.begin(number)
                if self._last is None:
                    level.miss(number * level.bin, int(t[at]))
            until = int(np.searchsorted(t, level.end))
            level.events += _add(level.counts.reshape(WINDOW, -1), t[at:until], cells[at:until], level.bin, level.start)
            at = until


def _fields(region: Region) -> tuple[int, int, int, int, int]:
    return region.cell, region.row, region.column, region.rows, region.columns


@njit(cache=True, nogil=True)
def _cells(x, y, p, region):  # type: ignore[no-untyped-def]
    """Number of the cell and polarity of events, -1 outside of the region."""
    cell, row, column, rows, columns = region
    found = np.empty(len(x), np.int32)
    for i in range(len(x)):
        r, c = np.int64(y[i]) // cell - row, np.int64(x[i]) // cell - column
        inside = 0 <= r < rows and 0 <= c < columns
        found[i] = (np.int64(p[i]) * rows + r) * columns + c if inside else -1
    return found


@njit(cache=True, nogil=True)
def _see(seen, x, y, p):  # type: ignore[no-untyped-def]
    """Add events to a histogram of (polarity, row, column) in the smallest cells."""
    for i in range(len(x)):
        seen[p[i], y[i] // SMALLEST_CELL, x[i] // SMALLEST_CELL] += 1


@njit(cache=True, nogil=True)
def _add(counts, t, cells, bin_ns, start):  # type: ignore[no-untyped-def]
    """Count events in (bins, cells); return how many there were."""
    events = 0
    for i in range(len(t)):
        if cells[i] >= 0:
            k = t[i] // bin_ns - start
            if counts[k, cells[i]] < 65535:
                counts[k, cells[i]] += 1
            events += 1
    return events
