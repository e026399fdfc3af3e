"""Recordings of any format that were compressed as a whole: they are unpacked to a temporary folder and read there."""

from __future__ import annotations

import bz2
import lzma
import tarfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from gzip import GzipFile
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import lz4.frame
from backports.zstd import ZstdError, ZstdFile

from esfo_core.errors import RecordingError

_OPENERS: dict[bytes, Callable[[Any], Any]] = {
    b"\x1f\x8b": lambda file: GzipFile(fileobj=file),
    b"\x28\xb5\x2f\xfd": ZstdFile,
    b"\x04\x22\x4d\x18": lz4.frame.LZ4FrameFile,
    b"BZh": bz2.BZ2File,
    b"\xfd7zXZ\0": lzma.LZMAFile,
}
_ZIP = b"PK\x03\x04"
PACKED = (*_OPENERS, _ZIP)
"""First bytes of compressed files and archives."""

SUFFIXES = (".gz", ".zst", ".zstd", ".lz4", ".bz2", ".xz", ".zip", ".tgz")
"""Ends of the names of compressed files."""

_BESIDE = (".txt", ".csv", ".md", ".yaml", ".json", ".png", ".jpg")
_TAR_MAGIC = slice(257, 262)
_BLOCK = 1 << 20


def packed_start(path: Path, size: int) -> bytes:
    """Return the first bytes of what is in a compressed file, empty for a ZIP archive. Raises RecordingError."""
    with path.open("rb") as file, _one_error():
        opener = _opener(file.read(8))
        file.seek(0)
        return b"" if opener is None else bytes(opener(file).read(size))


def is_archive(start: bytes) -> bool:
    """Whether what `packed_start` returned is that of an archive of files."""
    return not start or start[_TAR_MAGIC] == b"ustar"


def names_in(path: Path) -> list[str]:
    """Return the names of the files in a ZIP archive. Raises RecordingError for damage."""
    with _one_error(), ZipFile(path) as archive:
        return archive.namelist()


def unpack(path: Path, folder: Path) -> Path:
    """Unpack a compressed file or an archive to `folder`; return the recording in it, a file or a folder.

    Raises RecordingError for damage and for an archive of several recordings; OSError where there is no room.
    """
    target = folder / plain_name(path)
    with path.open("rb") as file, _one_error():
        opener = _opener(file.read(8))
        file.seek(0)
        if opener is None:
            with ZipFile(file) as archive:
                archive.extractall(folder / "archive")
            return _only(folder / "archive")
        with target.open("wb") as out:
            for block in _blocks(opener(file)):
                out.write(block)
        if not _is_tar(target):
            return target
        with tarfile.open(target) as tar:
            tar.extractall(folder / "archive", filter="data")
    target.unlink()
    return _only(folder / "archive")


def plain_name(path: Path) -> str:
    """Return the name of a compressed file without the end that says so."""
    name = path.name
    end = next((suffix for suffix in SUFFIXES if name.lower().endswith(suffix)), "")
    return name.removesuffix(name[len(name) - len(end) :]) if end else name


def _opener(start: bytes) -> Callable[[Any], Any] | None:
    return next((opener for magic, opener in _OPENERS.items() if start.startswith(magic)), None)


def _blocks(content: Any) -> Iterator[bytes]:
    """All there is; of data that were cut off, what came before."""
    while True:
        try:
            block = content.read1(_BLOCK)
        except EOFError:
            return
        if not block:
            return
        yield block


def _is_tar(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(_TAR_MAGIC.stop)[_TAR_MAGIC] == b"ustar"


def _only(folder: Path) -> Path:
    """The one recording of an unpacked archive: a bag's folder, or a file beside which there may be notes."""
    bags = [file.parent for file in folder.rglob("metadata.yaml")]
    if len(bags) == 1:
        return bags[0]
    files = [file for file in sorted(folder.rglob("*")) if file.is_file() and "__MACOSX" not in file.parts]
    chosen = [file for file in files if file.suffix.lower() not in _BESIDE] or files
    if len(chosen) != 1:
        names = ", ".join(str(file.relative_to(folder)) for file in files) or "none"
        raise RecordingError(f"the archive needs one recording; it has {names[:120]}")
    return chosen[0]


@contextmanager
def _one_error() -> Iterator[None]:
    try:
        yield
    except (BadZipFile, ZstdError, zlib.error, lzma.LZMAError, tarfile.TarError, EOFError, RuntimeError) as error:
        raise RecordingError(f"damaged or unreadable compressed file ({error})") from error
    except OSError as error:
        if error.errno is None:  # of a decompressor, not of the disk
            raise RecordingError(f"damaged or unreadable compressed file ({error})") from error
        raise
