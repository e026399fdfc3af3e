"""SQLite bags whose recorder was killed: messages may still be in the write-ahead log beside the file."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

from esfo_core.errors import RecordingError


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
