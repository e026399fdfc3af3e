"""HDF5 recordings, as Prophesee (`CD/events`) and the DSEC data set (`events/x`, `y`, `p`, `t`) have them.

Times are whole microseconds; DSEC's count from `t_offset`. Prophesee gives the sensor size in the attribute `geometry`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from esfo_core.codecs.columns import ColumnsDecoder
from esfo_core.errors import EsfoError, RecordingError
from esfo_core.events import EventArray, make_events
from esfo_core.recordings.reading_options import ReadingOptions
from esfo_core.recordings.recording import Recording

MAGIC = b"\x89HDF\r\n\x1a\n"

h5py: Any = None
with suppress(ImportError):
    import h5py  # type: ignore[no-redef]
with suppress(ImportError):  # registers the filters of its packages when loaded, Blosc of DSEC among them
    import hdf5plugin  # noqa: F401

_BLOCK = 1 << 18  # events
_COLUMNS = ("x", "y", "p", "t")
_PROPHESEE, _DSEC = "CD/events", "events"
_MAX_US = 2**62 // 1000
_FILTERS = {0x8ECF: "ECF of Prophesee, from their hdf5_ecf", 32001: "Blosc, from the package hdf5plugin"}


class Hdf5Recording(Recording):
    """Events of an HDF5 file; it holds no calibration.

    Where neither the options nor the file give the sensor size, the pixels of all events are read once for it.

    Raises RecordingError without h5py, for a file of neither convention, and for a compression filter that is missing.
    """

    def __init__(self, path: Path, options: ReadingOptions) -> None:
        super().__init__(path, path.stat().st_size)
        if h5py is None:
            raise RecordingError("HDF5 files need h5py: pip install h5py")
        self.encoding = "hdf5"
        self._read = 0
        with self._columns() as (columns, geometry):
            self._count = len(columns["t"])
            size = options.size or geometry
            self.width, self.height = size or _extent(columns)
        self.size_inferred = size is None
        ColumnsDecoder(self.width, self.height)

    def progress(self) -> float:
        """Fraction of the events read."""
        return self._read / max(1, self._count)

    def _packets(self) -> Iterator[EventArray]:
        decoder = ColumnsDecoder(self.width, self.height)
        self.statistics.decoder = decoder.statistics
        with self._columns() as (columns, _):
            for start in range(0, self._count, _BLOCK):
                events = _events(columns, start)
                self._read = min(self._count, start + _BLOCK)
                self.statistics.packets += 1
                yield from decoder.decode_parts(events.view(np.uint8))

    @contextmanager
    def _columns(self) -> Iterator[tuple[Mapping[str, Any], tuple[int, int] | None]]:
        """Open the file: its columns, with `t_offset` where there is one, and its sensor size."""
        with _one_error(), h5py.File(self.path, "r") as file:
            if isinstance(file.get(_PROPHESEE), h5py.Dataset):
                self.format = "HDF5, Prophesee"
                yield _prophesee(file[_PROPHESEE]), _geometry(file.attrs)
            elif isinstance(file.get(_DSEC), h5py.Group):
                self.format = "HDF5, DSEC"
                yield _dsec(file), None
            else:
                found = ", ".join(file) or "nothing"
                raise RecordingError(f"HDF5 without {_PROPHESEE} or {_DSEC}/x, y, p, t (it has {found[:80]})")


def _prophesee(table: Any) -> Mapping[str, Any]:
    names = table.dtype.names or ()
    if not set(_COLUMNS) <= set(names):
        raise RecordingError(f"{_PROPHESEE} has the fields {', '.join(names) or 'none'}; needed are x, y, p, t")
    _check(table, table.dtype["t"])
    return {name: table.fields(name) for name in _COLUMNS}


def _dsec(file: Any) -> Mapping[str, Any]:
    group = file[_DSEC]
    if not all(isinstance(group.get(name), h5py.Dataset) for name in _COLUMNS):
        raise RecordingError(f"{_DSEC} has {', '.join(group) or 'nothing'}; needed are x, y, p, t")
    columns = {name: group[name] for name in _COLUMNS}
    for column in columns.values():
        _check(column, column.dtype)
    lengths = [len(column) for column in columns.values()]
    if len(set(lengths)) != 1:
        raise RecordingError(f"the columns x, y, p, t are of different lengths: {lengths}")
    offset = file.get("t_offset")
    return {**columns, "t_offset": int(offset[()]) if offset is not None else 0}


def _check(data: Any, times: Any) -> None:
    """Raise RecordingError for columns that cannot be read correctly."""
    if data.ndim != 1:
        raise RecordingError(f"{data.name} has {data.ndim} dimensions, not one")
    if times.kind not in "iub":
        raise RecordingError(f"{data.name} holds numbers of type {times}, not whole ones")
    properties = data.id.get_create_plist()
    for i in range(properties.get_nfilters()):
        number, name = properties.get_filter(i)[0], properties.get_filter(i)[3].decode("ascii", "replace")
        if not h5py.h5z.filter_avail(number):
            raise RecordingError(f"compressed by a filter that is missing here: {_FILTERS.get(number, name or number)}")
    if len(data) and not data.id.get_storage_size():
        raise RecordingError(f"{data.name} claims {len(data)} values and holds none")


def _geometry(attributes: Mapping[str, Any]) -> tuple[int, int] | None:
    text = attributes.get("geometry")
    if text is None:
        return None
    text = text.decode("ascii", "replace") if isinstance(text, bytes) else str(text)
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise RecordingError(f"the sensor size is {text!r}")
    return int(width), int(height)


def _events(columns: Mapping[str, Any], start: int) -> EventArray:
    x, y, p, t = (_whole(columns[name][start : start + _BLOCK], name) for name in _COLUMNS)
    t = t + columns.get("t_offset", 0)
    for name, values, low, high in (("x", x, 0, 65535), ("y", y, 0, 65535), ("p", p, -1, 1), ("t", t, 0, _MAX_US)):
        if values.min() < low or values.max() > high:
            raise RecordingError(
                f"{name} from {values.min()} to {values.max()} in events {start} to {start + len(x) - 1}; "
                f"possible are {low} to {high}"
            )
    return make_events(x, y, p > 0, t * 1000)


def _whole(values: NDArray[Any], name: str) -> NDArray[np.int64]:
    if values.dtype.kind not in "iub":
        raise RecordingError(f"{name} holds numbers of type {values.dtype}, not whole ones")
    return values.astype(np.int64)


def _extent(columns: Mapping[str, Any]) -> tuple[int, int]:
    """Sensor size that just holds all events."""
    size = [0, 0]
    for i, name in enumerate("xy"):
        for start in range(0, len(columns[name]), _BLOCK):
            size[i] = max(size[i], int(columns[name][start : start + _BLOCK].max()) + 1)
    if 0 in size:
        raise RecordingError("HDF5 without an event")
    return size[0], size[1]


@contextmanager
def _one_error() -> Iterator[None]:
    try:
        yield
    except EsfoError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, OverflowError) as error:
        reason = (str(error).splitlines() or [""])[0]
        raise RecordingError(f"damaged or unreadable HDF5 file ({reason})") from error
