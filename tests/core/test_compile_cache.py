"""Numba gets a folder that can be written, whoever runs the code."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest

from esfo_core.compile_cache import ensure_writable_cache


@pytest.fixture
def blocked(tmp_path, monkeypatch):
    """A path below a file, which nobody can make a folder of; and a temporary folder."""
    (tmp_path / "file").write_text("")
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    return tmp_path / "file" / "folder"


def test_what_works_stays(tmp_path, blocked):
    for environment, package in (
        ({"NUMBA_CACHE_DIR": str(tmp_path / "cache")}, blocked),
        ({"HOME": str(blocked)}, tmp_path),
        ({"HOME": str(tmp_path)}, blocked),
    ):
        before = dict(environment)
        ensure_writable_cache(environment, package)
        assert environment == before


@pytest.mark.parametrize("told", [True, False])
def test_otherwise_it_is_a_folder_of_this_user_alone(blocked, told):
    environment = {"HOME": str(blocked)} | ({"NUMBA_CACHE_DIR": str(blocked)} if told else {})
    ensure_writable_cache(environment, blocked)
    folder = Path(environment["NUMBA_CACHE_DIR"])
    assert folder == Path(tempfile.gettempdir()) / f"esfo_numba_{os.getuid()}"
    assert folder.stat().st_mode & 0o777 == 0o700


def test_a_folder_that_others_can_write_is_not_used(blocked):
    (Path(tempfile.gettempdir()) / f"esfo_numba_{os.getuid()}").mkdir(mode=0o777)
    (Path(tempfile.gettempdir()) / f"esfo_numba_{os.getuid()}").chmod(0o777)
    environment = {"HOME": str(blocked)}
    ensure_writable_cache(environment, blocked)
    assert Path(environment["NUMBA_CACHE_DIR"]).stat().st_mode & 0o777 == 0o700
