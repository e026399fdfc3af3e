"""SQLite bags that do not open as they lie: with messages in a write-ahead log beside them, or without their end."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

from esfo_core.errors import RecordingError

_HEADER_SIZE = 100
_FILLING = bytes.fromhex("9d3b c7e1 5a86 f24d")  # for what is missing; no message holds it but by chance
_LEAST_FILLED = 4  # bytes at the end of a message that are taken for filling
_MOST_TIMES_CUT = 100  # what a header says beyond that is damage
_MOST_MISSING_ROWS = 10_000  # in a row; then no more is expected


def log_of(path: Path) -> Path | None:
    """Return the write-ahead log beside an SQLite file, None where there is none or nothing in it."""
    log = path.with_name(path.name + "-wal")
    return log if log.exists() and log.stat().st_size else None


def merged(path: Path, log: Path, folder: TemporaryDirectory[str]) -> Path:
    """Return a copy of an SQLite file in `folder` with its write-ahead log taken in; the bag itself stays as it is.

    Raises RecordingError where the two do not make one file.
    """
    copy = Path(folder.name) / path.name
    shutil.copyfile(path, copy)
    shutil.copyfile(log, copy.with_name(copy.name + "-wal"))
    try:
        with closing(sqlite3.connect(copy)) as database:
            database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
            database.execute("PRAGMA journal_mode=DELETE").fetchall()
    except sqlite3.Error as error:
        raise RecordingError(f"{log.name} of {log.stat().st_size} bytes cannot be taken in ({error})") from error
    return copy


def is_cut(path: Path) -> bool:
    """Return whether an SQLite file is shorter than its header says. Raises OSError."""
    with path.open("rb") as file:
        header = file.read(_HEADER_SIZE)
    return len(header) == _HEADER_SIZE and path.stat().st_size < _size_by(header)


def rescued(path: Path, folder: TemporaryDirectory[str]) -> tuple[Path, int]:
    """Return a copy in `folder` of all messages that a cut-off SQLite bag still holds, and how many bytes are missing.

    Raises RecordingError where not even its tables are left.
    """
    padded, copy = Path(folder.name) / f"padded_{path.name}", Path(folder.name) / path.name
    with path.open("rb") as file:
        size = _size_by(file.read(_HEADER_SIZE))
    if size > _MOST_TIMES_CUT * path.stat().st_size:
        raise RecordingError(f"{path.name} should have {size} bytes and has {path.stat().st_size}")
    shutil.copyfile(path, padded)
    with padded.open("ab") as file:  # SQLite refuses a file that is too short as a whole
        missing = size - path.stat().st_size
        file.write((_FILLING * (missing // len(_FILLING) + 1))[:missing])
    try:
        with closing(sqlite3.connect(padded)) as old, closing(sqlite3.connect(copy)) as new:
            _copy_rows(old, new)
            new.commit()
    except OSError:
        raise
    except Exception as error:  # damaged bytes raise anything
        raise RecordingError(
            f"{path.name} is cut off, and nothing can be read of it ({(str(error).splitlines() or [''])[0][:100]})"
        ) from error
    padded.unlink()
    return copy, size - path.stat().st_size


def _is_filled(value: object) -> bool:
    """Whether a part of a message is filling."""
    if not isinstance(value, bytes):
        return False
    return _FILLING in value or (len(value) >= _LEAST_FILLED and value[-_LEAST_FILLED:] in _FILLING * 2)


def _size_by(header: bytes) -> int:
    page = int.from_bytes(header[16:18], "big")
    return (65536 if page == 1 else page) * int.from_bytes(header[28:32], "big")


def _copy_rows(old: sqlite3.Connection, new: sqlite3.Connection) -> None:
    for name, statement in old.execute("SELECT name, sql FROM sqlite_master WHERE type = 'table'").fetchall():
        if name.startswith("sqlite_"):
            continue
        new.execute(statement)
        columns = len(old.execute(f"PRAGMA table_info({name})").fetchall())
        insert = f"INSERT INTO {name} VALUES ({','.join('?' * columns)})"
        row_id, missing = 1, 0
        while missing < _MOST_MISSING_ROWS:
            try:
                row = old.execute(f"SELECT * FROM {name} WHERE rowid = ?", (row_id,)).fetchone()
            except sqlite3.DatabaseError:
                row = None
            if row is not None and not any(_is_filled(value) for value in row):
                new.execute(insert, row)
            missing = missing + 1 if row is None else 0
            row_id += 1
