"""Images of the events of a stream, stored until the motion is known that is drawn into them."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from esfo_core.events import EventArray
from esfo_frontend.overlay import Canvas


class Frames:
    """One image for each period with events, counted from the first event; stored in a temporary file.

    Iterating yields the end of the period in ns, and the levels (height, width) of its `Canvas`.
    """

    def __init__(self, width: int, height: int, period_ns: int, folder: Path) -> None:
        """folder: of the temporary file, which takes `width` x `height` bytes per image."""
        self._shape, self._period = (height, width), period_ns
        self._canvas = Canvas(width, height)
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115, closed by `close`
        self._ends: list[int] = []
        self._first: int | None = None

    def add(self, events: EventArray) -> None:
        """Take in events (N,), time-sorted and following earlier ones."""
        while len(events):
            t = int(events["t"][0])
            self._first = t if self._first is None else self._first
            end = t + self._period - (t - self._first) % self._period
            if not self._ends or self._ends[-1] != end:
                self._keep()
                self._ends.append(end)
            n = int(np.searchsorted(events["t"], end))
            self._canvas.add(events[:n])
            events = events[n:]

    def __iter__(self) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        if self._ends:
            self._keep()
        self._file.seek(0)
        for end in self._ends:
            data = self._file.read(self._shape[0] * self._shape[1])
            yield end, np.frombuffer(data, np.uint8).reshape(self._shape)

    def close(self) -> None:
        """Delete the temporary file."""
        self._file.close()

    def _keep(self) -> None:
        if self._ends:
            self._file.write(self._canvas.levels.data)
            self._canvas.levels[:] = 0
