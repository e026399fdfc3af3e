"""Recordings whose events lie in columns: what HDF5 and NumPy files share."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from esfo_core.codecs.columns import ColumnsDecoder
from esfo_core.codecs.text_layout import UNIT_POWERS
from esfo_core.errors import RecordingError
from esfo_core.events import EventArray, make_events
from esfo_core.recordings.extent import Extent
from esfo_core.recordings.reading_options import ReadingOptions
from esfo_core.recordings.recording import Recording
from esfo_core.recordings.text_guess import likely_columns, likely_unit

_BLOCK = 1 << 18  # events
_SAMPLE = 1000
_COLUMNS = ("x", "y", "p", "t")
_MAX_NS = 2**62
_MAX_PIXEL = 65535
_STRAY_SHARE = 0.01  # of the pixels of a block, that may be impossible

NAMES = {
    "x": ("x", "xs", "x_coordinate", "col"),
    "y": ("y", "ys", "y_coordinate", "row"),
    "p": ("p", "ps", "pol", "polarity", "polarities", "on"),
    "t": ("t", "ts", "time", "times", "timestamp", "timestamps", "t_us", "t_ns", "t_s"),
}
"""What the columns are called."""


@dataclass(frozen=True)
class Columns:
    """Columns of events in a file that is open.

    form: what their layout is called. data: what gives values by slices, for each of x, y, p, t. offset: added to the
    times, in their unit. size: width and height of the sensor where the file has it. unit: of the times, empty where
    the file leaves it open. guesses: what was found out from the values, with the option that says otherwise.
    """

    form: str
    data: dict[str, Any]
    offset: int | float = 0
    size: tuple[int, int] | None = None
    unit: str = ""
    guesses: tuple[str, ...] = ()


class Part:
    """One column of a table (N, 4)."""

    def __init__(self, table: Any, column: int) -> None:
        self._table, self._column = table, column

    def __len__(self) -> int:
        return len(self._table)

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        """Return the values of these rows."""
        return np.asarray(self._table[rows, self._column])


def named(names: Any) -> dict[str, str]:
    """Return the name that each of x, y, p, t has among `names`; those that have none are left out."""
    return {key: name for key, known in NAMES.items() for name in names if str(name).lower() in known}


def parts_of(table: Any, options: ReadingOptions) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the columns of a table (N, 4), and what was guessed about them. Raises RecordingError where that fails."""
    guesses: tuple[str, ...] = ()
    order = tuple(options.columns.replace(" ", "").split(",")) if options.columns else ()
    if not order:
        rows = [[Decimal(repr(value)) for value in row] for row in np.asarray(table[:_SAMPLE]).tolist()]
        order = likely_columns(rows, commas=True)
        guesses = (f"columns {','.join(order)} (option columns)",)
    if sorted(order) != sorted(_COLUMNS):
        raise RecordingError(f"columns are {','.join(order)!r}; needed are x, y, p and t, once each")
    return {name: Part(table, order.index(name)) for name in _COLUMNS}, guesses


class ColumnsRecording(Recording):
    """Events in columns; it holds no calibration.

    Where neither the options nor the file give the sensor size, the pixels of all events are read once for it.
    """

    def __init__(self, path: Path, options: ReadingOptions) -> None:
        super().__init__(path, path.stat().st_size)
        self._options = options
        self._read = 0
        with self._columns() as columns:
            self.format, self.guesses = columns.form, columns.guesses
            lengths = [len(columns.data[name]) for name in _COLUMNS]
            if len(set(lengths)) != 1:
                raise RecordingError(f"the columns x, y, p, t are of different lengths: {lengths}")
            self._count = lengths[0]
            self._unit = options.time_unit or columns.unit or self._likely_unit(columns)
            size = columns.size or options.size
            self.width, self.height = size or self._extent(columns)
        self.size_inferred = size is None
        ColumnsDecoder(self.width, self.height)

    @abstractmethod
    def _columns(self) -> AbstractContextManager[Columns]:
        """Open the file, with every failure as RecordingError."""

    def progress(self) -> float:
        """Fraction of the events read."""
        return self._read / max(1, self._count)

    def _packets(self) -> Iterator[EventArray]:
        decoder = ColumnsDecoder(self.width, self.height)
        self.statistics.decoder = decoder.statistics
        with self._columns() as columns:
            for start in range(0, self._count, _BLOCK):
                events = self._events(columns, start)
                self._read = min(self._count, start + _BLOCK)
                self.statistics.packets += 1
                yield from decoder.decode_parts(events.view(np.uint8))

    def _likely_unit(self, columns: Columns) -> str:
        sample = np.asarray(columns.data["t"][:_SAMPLE])
        _check_kind("t", sample, "iubf")
        offset = Decimal(repr(columns.offset))
        times = [Decimal(repr(t)) + offset for t in sample.tolist() if np.isfinite(t)]
        whole = sample.dtype.kind != "f" or not (sample % 1).any()
        unit = likely_unit([Decimal(int(t)) for t in times] if whole else times)
        self.guesses = (*self.guesses, f"time in {unit} (option time_unit)")
        return unit

    def _events(self, columns: Columns, start: int) -> EventArray:
        block = slice(start, start + _BLOCK)
        x, y = (_pixels(columns, name, start) for name in "xy")
        p = _whole(columns.data["p"][block], "p")
        if p.min() < -1 or p.max() > 1:
            raise RecordingError(_beyond("p", p, start, -1, 1))
        return make_events(x, y, p > 0, self._times(np.asarray(columns.data["t"][block]), columns.offset, start))

    def _times(self, t: NDArray[Any], offset: float, start: int) -> NDArray[np.int64]:
        """Return times (N,) in ns."""
        _check_kind("t", t, "iubf")
        factor = 10 ** UNIT_POWERS[self._unit]
        low, high = t.min(), t.max()
        if not 0 <= float(low) + float(offset) <= float(high) + float(offset) <= _MAX_NS / factor:
            raise RecordingError(_beyond("t", t, start, 0, _MAX_NS // factor))
        if t.dtype.kind == "f" or isinstance(offset, float):
            return np.asarray(np.rint((t.astype(np.float64) + offset) * factor), np.int64)
        return np.asarray((t.astype(np.int64) + offset) * factor)

    def _extent(self, columns: Columns) -> tuple[int, int]:
        extent = Extent()
        for start in range(0, self._count, _BLOCK):
            extent.add(*(_pixels(columns, name, start) for name in "xy"))
        return extent.size()


def _pixels(columns: Columns, name: str, start: int) -> NDArray[np.int64]:
    """Columns or rows of the events from `start` on; single impossible ones become `_MAX_PIXEL`, off every sensor."""
    values = _whole(columns.data[name][start : start + _BLOCK], name)
    wrong = (values < 0) | (values > _MAX_PIXEL)
    if np.count_nonzero(wrong) > _STRAY_SHARE * len(values):
        raise RecordingError(_beyond(name, values, start, 0, _MAX_PIXEL))
    return np.where(wrong, _MAX_PIXEL, values) if wrong.any() else values


def _whole(values: Any, name: str) -> NDArray[np.int64]:
    values = np.asarray(values)
    _check_kind(name, values, "iubf")
    whole: NDArray[np.int64] = values.astype(np.int64)
    if values.dtype.kind == "f" and (whole != values).any():
        raise RecordingError(f"{name} holds numbers that are not whole, such as {values[whole != values][0]}")
    return whole


def _check_kind(name: str, values: NDArray[Any], kinds: str) -> None:
    if values.dtype.kind not in kinds:
        raise RecordingError(f"{name} holds values of type {values.dtype}, not numbers")


def _beyond(name: str, values: NDArray[Any], start: int, low: int, high: int) -> str:
    return (
        f"{name} from {values.min()} to {values.max()} in events {start} to {start + len(values) - 1}; possible are "
        f"{low} to {high}"
    )
