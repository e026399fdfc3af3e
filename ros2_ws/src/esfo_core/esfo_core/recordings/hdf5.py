"""HDF5 recordings: columns x, y, p, t in any group (DSEC, M3ED, event_utils), or a table of events (Prophesee, MVSEC).

Times count from `t_offset` where there is one beside the columns or in the root. Prophesee gives the sensor size in the
attribute `geometry`, event_utils in `sensor_resolution`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from esfo_core.errors import EsfoError, RecordingError
from esfo_core.recordings.columns import Columns, ColumnsRecording, named, parts_of
from esfo_core.recordings.reading_options import ReadingOptions

MAGIC = b"\x89HDF\r\n\x1a\n"

h5py: Any = None
with suppress(ImportError):
    import h5py  # type: ignore[no-redef]
with suppress(ImportError):  # registers the filters of its packages when loaded, Blosc of DSEC among them
    import hdf5plugin  # noqa: F401

_PROPHESEE, _DSEC = "CD/events", "events"
_FILTERS = {0x8ECF: "ECF of Prophesee, from their hdf5_ecf", 32001: "Blosc, from the package hdf5plugin"}
_FOUR = 4


class Hdf5Recording(ColumnsRecording):
    """Events of an HDF5 file; it holds no calibration.

    group: where in the file they are, needed only where several places hold events.

    Raises RecordingError without h5py, for a file without events, and for a compression filter that is missing.
    """

    encoding = "hdf5"

    def __init__(self, path: Path, group: str | None, options: ReadingOptions) -> None:
        if h5py is None:
            raise RecordingError("HDF5 files need h5py: pip install h5py")
        self._group = group
        super().__init__(path, options)

    @contextmanager
    def _columns(self) -> Iterator[Columns]:
        with _one_error(), h5py.File(self.path, "r") as file:
            yield self._open(file, self._place(file))

    def _place(self, file: Any) -> str:
        """Return the one place of the file that holds events, or the one asked for."""
        if self._group is not None and self._group.strip("/") in file:
            return self._group.strip("/")
        places = ["/"] if _holds_events(file) else []
        file.visititems(lambda name, item: places.append(name) if _holds_events(item) else None)
        for usual in (_PROPHESEE, _DSEC):
            if self._group is None and isinstance(file.get(usual), h5py.Dataset if usual == _PROPHESEE else h5py.Group):
                return usual
        names = ", ".join(places)
        if self._group is not None:
            raise RecordingError(f"no events in {self._group!r}; events are in: {names or 'nothing'}")
        if len(places) > 1:
            raise RecordingError(f"events in several places, choose one of {names}")
        if not places:
            found = ", ".join(file) or "nothing"
            raise RecordingError(f"HDF5 without columns x, y, p, t or a table of events (it has {found[:80]})")
        return places[0]

    def _open(self, file: Any, place: str) -> Columns:
        item = file[place]
        size = _geometry(file.attrs)
        if isinstance(item, h5py.Group):
            names = named(item)
            if len(names) != _FOUR:
                raise RecordingError(f"{place} has {', '.join(item) or 'nothing'}; needed are x, y, p, t")
            data = {key: item[name] for key, name in names.items()}
            for column in data.values():
                _check(column, 1)
            # DSEC's own files tell no unit, but all of that layout have us.
            usual = place == _DSEC and "t_offset" in file and data["t"].dtype.kind in "iu"
            form = "DSEC" if place == _DSEC else place
            return Columns(f"HDF5, {form}", data, _offset(file, item), size, "us" if usual else "")
        if item.dtype.names:
            fields = named(item.dtype.names)
            if len(fields) != _FOUR:
                raise RecordingError(f"{place} has the fields {', '.join(item.dtype.names)}; needed are x, y, p, t")
            _check(item, 1)
            data = {key: item.fields(name) for key, name in fields.items()}
            prophesee = place == _PROPHESEE and item.dtype[fields["t"]].kind in "iu"
            form = "Prophesee" if place == _PROPHESEE else place
            return Columns(f"HDF5, {form}", data, 0, size, "us" if prophesee else "")
        if item.ndim != 2 or item.shape[1] != _FOUR:
            raise RecordingError(f"{place} has the fields none; needed are x, y, p, t")
        _check(item, 2)
        data, guesses = parts_of(item, self._options)
        return Columns(f"HDF5, {place}", data, _offset(file, item.parent), size, guesses=guesses)


def _holds_events(item: Any) -> bool:
    if isinstance(item, h5py.Group):
        return len(named(item)) == _FOUR
    return len(named(item.dtype.names or ())) == _FOUR or (
        item.name.endswith("events") and item.ndim == 2 and item.shape[1] == _FOUR
    )


def _offset(file: Any, group: Any) -> int | float:
    found = group.get("t_offset", file.get("t_offset"))
    if found is None:
        return 0
    value = np.asarray(found[()]).ravel()
    if len(value) != 1 or value.dtype.kind not in "iuf" or not np.isfinite(value[0]):
        raise RecordingError(f"t_offset is {str(found[()])[:60]}, not one number")
    number: int | float = value[0].item()
    return number


def _check(data: Any, dimensions: int) -> None:
    """Refuse what would be read wrongly, endlessly or not at all."""
    if data.ndim != dimensions:
        raise RecordingError(f"{data.name} has {data.ndim} dimensions, not {dimensions}")
    properties = data.id.get_create_plist()
    for i in range(properties.get_nfilters()):
        number, name = properties.get_filter(i)[0], properties.get_filter(i)[3].decode("ascii", "replace")
        if not h5py.h5z.filter_avail(number):
            raise RecordingError(f"compressed by a filter that is missing here: {_FILTERS.get(number, name or number)}")
    if len(data) and not data.id.get_storage_size():
        raise RecordingError(f"{data.name} claims {len(data)} values and holds none")


def _geometry(attributes: Mapping[str, Any]) -> tuple[int, int] | None:
    resolution = np.asarray(attributes.get("sensor_resolution", ())).ravel()
    if len(resolution) == 2 and resolution.dtype.kind in "iu" and (resolution > 0).all():
        return int(resolution[1]), int(resolution[0])  # rows first, as event_utils writes it
    text = attributes.get("geometry")
    if text is None:
        return None
    text = text.decode("ascii", "replace") if isinstance(text, bytes) else str(text)
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise RecordingError(f"the sensor size is {text!r}")
    return int(width), int(height)


@contextmanager
def _one_error() -> Iterator[None]:
    try:
        yield
    except EsfoError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, OverflowError) as error:
        reason = (str(error).splitlines() or [""])[0]
        raise RecordingError(f"damaged or unreadable HDF5 file ({reason})") from error
