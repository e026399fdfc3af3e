"""AEDAT4 files of iniVation: a header, then packets of several streams, each compressed by itself.

The container is read here because of what the libraries do with damage: dv-processing 2.0.4 reads nothing of a file
that was cut off and hangs for ever in a damaged packet, and aedat 2.3.0 gives up at the first damaged packet.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO
from xml.etree import ElementTree

from backports.zstd import ZstdDecompressor, ZstdError
from lz4.frame import LZ4FrameDecompressor

from esfo_core.codecs.aedat4 import Aedat4Decoder
from esfo_core.errors import RecordingError
from esfo_core.events import EventArray
from esfo_core.recordings.flatbuffer import RootTable
from esfo_core.recordings.recording import Recording

MAGIC = b"#!AER-DAT4.0\r\n"

LARGEST_PACKET = 1 << 28
"""Bytes, decompressed; 16 million events. A larger one is damage."""

_COMPRESSIONS = ("none", "LZ4", "LZ4", "Zstandard", "Zstandard")
_PACKET_HEAD = struct.Struct("<ii")  # stream, bytes that follow


class Aedat4Recording(Recording):
    """Events of one stream of an AEDAT4 file; it holds no calibration.

    stream: number of the event stream, needed only when there are several.

    Raises RecordingError for a damaged header, no event stream, or several unless `stream` names one.
    """

    def __init__(self, path: Path, stream: str | None = None) -> None:
        super().__init__(path, path.stat().st_size)
        with path.open("rb") as file:
            header = RootTable(_header(file, self.size_bytes), "IOHE")
            self._start = file.tell()
        compression = header.number(0, "<i", 0)
        if not 0 <= compression < len(_COMPRESSIONS):
            raise RecordingError(f"unknown compression {compression}")
        self._compression = _COMPRESSIONS[compression]
        table = header.number(1, "<q", -1)  # after the last packet; -1 where writing was interrupted
        self._end = table if self._start <= table <= self.size_bytes else self.size_bytes
        self._table_lost = max(0, table - self.size_bytes + 1)
        self._stream, self.width, self.height = _choose(_streams(header.vector(2, 1)), stream)
        self.encoding = "aedat4"
        self.format = f"AEDAT4, {self._compression}"
        self._read = self._start
        Aedat4Decoder(self.width, self.height)

    def progress(self) -> float:
        """Fraction of the bytes read."""
        return self._read / self._end

    def _packets(self) -> Iterator[EventArray]:
        decoder = Aedat4Decoder(self.width, self.height)
        statistics = self.statistics
        statistics.decoder = decoder.statistics
        statistics.bytes_lost = self._table_lost
        for packet in self._compressed_packets():
            try:
                words = RootTable(_decompress(packet, self._compression), "EVTS").vector(0, decoder.word.itemsize)
            except RecordingError:
                statistics.packets_damaged += 1
                continue
            statistics.packets += 1
            yield from decoder.decode_parts(words)

    def _compressed_packets(self) -> Iterator[bytes]:
        """Packets of the event stream; counts the bytes after the last that is whole."""
        self._read = self._start
        with self.path.open("rb") as file:
            file.seek(self._start)
            while self._read < self._end:
                head = file.read(_PACKET_HEAD.size)
                stream, size = _PACKET_HEAD.unpack(head) if len(head) == _PACKET_HEAD.size else (0, -1)
                if not 0 <= size <= self._end - file.tell():  # cut off here, or nonsense from here on
                    self.statistics.bytes_lost += self._end - self._read
                    break
                self._read = file.tell() + size
                if stream == self._stream:
                    yield file.read(size)
                else:
                    file.seek(size, 1)
            self._read = self._end


def _header(file: BinaryIO, size_bytes: int) -> bytes:
    file.seek(len(MAGIC))
    prefix = file.read(4)
    size = int.from_bytes(prefix, "little")
    if len(prefix) < 4 or size > size_bytes - file.tell():
        raise RecordingError(f"the header of {size} bytes is longer than the file")
    return prefix + file.read(size)


def _decompress(data: bytes, compression: str) -> bytes:
    if compression == "none":
        return data
    decompressor = LZ4FrameDecompressor() if compression == "LZ4" else ZstdDecompressor()
    try:
        content = bytes(decompressor.decompress(data, max_length=LARGEST_PACKET))
    except (RuntimeError, ZstdError) as error:
        raise RecordingError(str(error)) from error
    if not decompressor.eof or decompressor.unused_data:
        raise RecordingError("a packet that is not whole, or too large")
    return content


def _streams(info: bytes) -> dict[str, tuple[int, int]]:
    """Sensor sizes of the event streams by their numbers, from the XML of the header."""
    try:
        root = ElementTree.fromstring(info)
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise RecordingError(f"the list of streams is damaged ({error})") from error
    sizes = {}
    for node in root.iterfind("node[@name='outInfo']/node"):
        if node.findtext("attr[@key='typeIdentifier']") == "EVTS":
            size = [node.findtext(f"node[@name='info']/attr[@key='{key}']") or "" for key in ("sizeX", "sizeY")]
            if not all(number.isdecimal() for number in size):
                raise RecordingError(f"the header gives the sensor size {size[0]!r} x {size[1]!r}")
            sizes[node.get("name", "")] = (int(size[0]), int(size[1]))
    return sizes


def _choose(sizes: dict[str, tuple[int, int]], wanted: str | None) -> tuple[int, int, int]:
    names = ", ".join(sizes) or "none"
    if not sizes or (wanted is not None and wanted not in sizes):
        raise RecordingError(f"no event stream {wanted or ''!r}; event streams: {names}".replace("stream ''", "stream"))
    if wanted is None and len(sizes) > 1:
        raise RecordingError(f"several event streams, choose one of {names}")
    name = wanted or next(iter(sizes))
    if not name.isdecimal():
        raise RecordingError(f"the event stream {name!r} has no number")
    return (int(name), *sizes[name])
