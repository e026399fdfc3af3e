"""Recordings as NumPy files: `.npy` of a structured array or a table (N, 4), `.npz` of columns or of one such array."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile, is_zipfile

import numpy as np

from esfo_core.errors import EsfoError, RecordingError
from esfo_core.recordings.columns import Columns, ColumnsRecording, named, parts_of

MAGIC = b"\x93NUMPY"


def is_npz(path: Path) -> bool:
    """Whether a file is an archive of NumPy arrays only. Raises OSError."""
    if not is_zipfile(path):
        return False
    with ZipFile(path) as archive:
        names = archive.namelist()
    return bool(names) and all(name.endswith(".npy") for name in names)


class NumpyRecording(ColumnsRecording):
    """Events of a NumPy file. Raises RecordingError for arrays that are no events."""

    encoding = "numpy"

    @contextmanager
    def _columns(self) -> Iterator[Columns]:
        with _one_error():
            content = np.load(self.path, mmap_mode="r", allow_pickle=False)
            arrays = dict(content) if hasattr(content, "files") else {"": content}
        by_name = named(arrays)
        if len(by_name) == len("xypt"):
            yield Columns("NumPy, columns", {key: _row(arrays[name], name) for key, name in by_name.items()})
            return
        fitting = [array for array in arrays.values() if array.dtype.names or (array.ndim == 2 and array.shape[1] == 4)]
        if len(fitting) != 1:
            found = ", ".join(f"{name or 'one array'} {array.dtype} {array.shape}" for name, array in arrays.items())
            raise RecordingError(f"NumPy file without columns x, y, p, t or one table of them (it has {found[:120]})")
        yield self._table(fitting[0])

    def _table(self, table: Any) -> Columns:
        if not table.dtype.names:
            data, guesses = parts_of(table, self._options)
            return Columns("NumPy, table", data, guesses=guesses)
        fields = named(table.dtype.names)
        if len(fields) != len("xypt") or table.ndim != 1:
            raise RecordingError(f"NumPy array {table.shape} of {', '.join(table.dtype.names)}; needed are x, y, p, t")
        return Columns("NumPy, structured", {key: table[name] for key, name in fields.items()})


def _row(array: Any, name: str) -> Any:
    if array.ndim != 1:
        raise RecordingError(f"{name} has {array.ndim} dimensions, not one")
    return array


@contextmanager
def _one_error() -> Iterator[None]:
    try:
        yield
    except (EsfoError, FileNotFoundError, PermissionError):
        raise
    except (OSError, ValueError, EOFError, KeyError, BadZipFile, MemoryError, SyntaxError, TypeError) as error:
        reason = (str(error).splitlines() or [""])[0]
        raise RecordingError(f"damaged or unreadable NumPy file ({reason[:200]})") from error
