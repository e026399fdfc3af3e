"""A file as a stream of bytes, decompressed where it is compressed."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from gzip import BadGzipFile, GzipFile
from io import BufferedReader
from pathlib import Path
from typing import Protocol, cast
from zipfile import BadZipFile, ZipExtFile, ZipFile

from backports.zstd import ZstdError, ZstdFile

from esfo_core.errors import RecordingError

_GZIP, _ZIP, _ZSTANDARD = b"\x1f\x8b", b"PK\x03\x04", b"\x28\xb5\x2f\xfd"
COMPRESSED = (_GZIP, _ZIP, _ZSTANDARD)
"""First bytes of compressed files."""

_BLOCK = 1 << 20
_PREFERRED = "events.txt"  # in archives of the Event Camera Dataset, beside poses and calibration


class _Reader(Protocol):
    def read1(self, size: int, /) -> bytes: ...


class ByteStream:
    """Reads a file from its start, in blocks of up to 1 MiB; memory does not grow with its length.

    position: bytes of the file read so far. cut: the compressed data ended before their end mark; what came was good.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.position = 0
        self.cut = False

    def blocks(self) -> Iterator[bytes]:
        """Yield all bytes, decompressed. Raises RecordingError for damage and for archives without one clear file."""
        with self.path.open("rb") as file, ExitStack() as stack, _one_error():
            reader = _decompressed(file, stack)
            while block := self._read(reader):
                self.position = file.tell()
                yield block
            self.position = self.path.stat().st_size  # the table at the end of an archive is read first

    def _read(self, reader: _Reader) -> bytes:
        try:
            return reader.read1(_BLOCK)
        except EOFError:
            self.cut = True
            return b""


def _decompressed(file: BufferedReader, stack: ExitStack) -> _Reader:
    start = file.read(4)
    file.seek(0)
    if start.startswith(_GZIP):
        return stack.enter_context(GzipFile(fileobj=file))
    if start.startswith(_ZSTANDARD):
        return stack.enter_context(ZstdFile(file))
    if start.startswith(_ZIP):
        archive = stack.enter_context(ZipFile(file))
        return cast(ZipExtFile, stack.enter_context(archive.open(_choose(archive))))
    return file


def _choose(archive: ZipFile) -> str:
    names = [name for name in archive.namelist() if name.endswith((".txt", ".csv")) and not name.startswith("__MACOSX")]
    preferred = [name for name in names if Path(name).name == _PREFERRED]
    chosen = preferred or names
    if len(chosen) != 1:
        raise RecordingError(
            f"the archive needs one {_PREFERRED}, or one .txt or .csv file; it has {', '.join(names) or 'none'}"
        )
    return chosen[0]


@contextmanager
def _one_error() -> Iterator[None]:
    try:
        yield
    except (BadGzipFile, BadZipFile, ZstdError, zlib.error, NotImplementedError, RuntimeError) as error:
        raise RecordingError(f"damaged or unreadable compressed file ({error})") from error
