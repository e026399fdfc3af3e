"""AEDAT 2.0 files of jAER: lines that begin with #, and then addresses and times."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from esfo_core.codecs.aedat2 import Aedat2Decoder, DavisDecoder, Dvs128Decoder
from esfo_core.errors import RecordingError
from esfo_core.events import EventArray
from esfo_core.recordings.reading_options import ReadingOptions
from esfo_core.recordings.recording import Recording

MAGIC = b"#!AER-DAT2.0"

_BLOCK = 1 << 20
_LONGEST_LINE = 4096
_CHIPS: dict[str, tuple[type[Aedat2Decoder], tuple[int, int]]] = {
    "dvs128": (Dvs128Decoder, (128, 128)),
    "tmpdiff128": (Dvs128Decoder, (128, 128)),
    "davis240": (DavisDecoder, (240, 180)),
    "davis346": (DavisDecoder, (346, 260)),
    "davis128": (DavisDecoder, (128, 128)),
    "davis640": (DavisDecoder, (640, 480)),
}
"""Decoders and sensor sizes by a part of the names that the header has for the chip."""


class Aedat2Recording(Recording):
    """Events of an AEDAT 2.0 file; it holds no calibration.

    Raises RecordingError where neither the header nor the options tell the chip or its size.
    """

    encoding = "aedat2"

    def __init__(self, path: Path, options: ReadingOptions) -> None:
        super().__init__(path, path.stat().st_size)
        with path.open("rb") as file:
            header, self._start = _header(file)
        known = {name: chip for name, chip in _CHIPS.items() if name in header.lower().replace("_", "")}
        if known:
            name, (self._decoder, size) = next(iter(known.items()))
        elif options.size is not None:
            name = "unknown chip"
            self._decoder, size = (Dvs128Decoder if options.size == (128, 128) else DavisDecoder), options.size
        else:
            raise RecordingError(
                f"the header names no chip of {', '.join(_CHIPS)}; say the sensor size by the options width and height"
            )
        self.width, self.height = size
        self.format = f"AEDAT 2.0, {name}"
        self._read = self._start

    def progress(self) -> float:
        """Fraction of the bytes read."""
        return self._read / self.size_bytes

    def _packets(self) -> Iterator[EventArray]:
        decoder = self._decoder(self.width, self.height)
        self.statistics.decoder = decoder.statistics
        self._read = self._start
        with self.path.open("rb") as file:
            file.seek(self._start)
            while block := file.read(_BLOCK):
                self.statistics.packets += 1
                self._read = file.tell()
                yield from decoder.decode_parts(block)


def _header(file: BinaryIO) -> tuple[str, int]:
    """Return the lines that begin with #, and the position after them."""
    lines: list[str] = []
    position = 0
    while True:
        line = file.readline(_LONGEST_LINE)
        printable = all(32 <= byte < 127 or byte in b"\t\r\n" or byte >= 0xA0 for byte in line)
        if not line.startswith(b"#") or not line.endswith(b"\n") or not printable:
            return "\n".join(lines), position
        lines.append(line.decode("latin-1"))
        position = file.tell()
