"""A file that cannot be written to its end is named, and no half of it stays."""

from __future__ import annotations

import errno

import pytest

from esfo_core.errors import EsfoError
from esfo_core.result_files import whole_file


def test_a_full_disk(tmp_path):
    path = tmp_path / "report.html"
    path.write_text("half")
    with pytest.raises(EsfoError, match=r"report\.html: No space left on device"), whole_file(path):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert not path.exists()


def test_a_folder_in_the_way_stays(tmp_path):
    with pytest.raises(EsfoError, match="Is a directory"), whole_file(tmp_path):
        tmp_path.write_text("x")
    assert tmp_path.exists()


def test_what_goes_well(tmp_path):
    with whole_file(tmp_path / "a") as path:
        path.write_text("x")
    assert path.read_text() == "x"
