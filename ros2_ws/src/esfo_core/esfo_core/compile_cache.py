"""Where Numba keeps what it has compiled: a place that this user can write, or importing ends in a traceback."""

from __future__ import annotations

import os
import stat
import sys
import tempfile
from collections.abc import MutableMapping
from pathlib import Path

_VARIABLE = "NUMBA_CACHE_DIR"


def ensure_writable_cache(environment: MutableMapping[str, str], package: Path) -> None:
    """Let Numba use the temporary folder where it could not write where it is told, beside the code, or at home.

    environment: of this process; `NUMBA_CACHE_DIR` in it is changed where needed. package: folder of the code.
    """
    told = environment.get(_VARIABLE)
    if _can_write(Path(told)) if told else _can_write(package / "__pycache__") or _home_can_be_written(environment):
        return
    environment[_VARIABLE] = str(_own_folder(Path(tempfile.gettempdir())))
    numba = sys.modules.get("numba")
    if numba is not None:  # it has read the environment already
        numba.config.CACHE_DIR = environment[_VARIABLE]


def _can_write(folder: Path) -> bool:
    """Whether a file can be written into a folder, which is made where it can be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)


def _home_can_be_written(environment: MutableMapping[str, str]) -> bool:
    try:
        home = Path(environment["HOME"] if "HOME" in environment else Path.home())
    except RuntimeError:  # a user without one
        return False
    return _can_write(Path(environment.get("XDG_CACHE_HOME") or home / ".cache") / "numba")


def _own_folder(temporary: Path) -> Path:
    """A folder of this user alone: what is loaded from it is code."""
    folder = temporary / f"esfo_numba_{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return Path(tempfile.mkdtemp(prefix="esfo_numba_"))
    mine = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o022
    return folder if mine else Path(tempfile.mkdtemp(prefix="esfo_numba_"))
