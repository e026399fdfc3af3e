"""Prophesee files: RAW (EVT2, EVT2.1, EVT3) and DAT, both a header of `%` lines and then the data of one stream."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from esfo_core.codecs import decoder
from esfo_core.errors import RecordingError
from esfo_core.events import EventArray
from esfo_core.recordings.reading_options import ReadingOptions
from esfo_core.recordings.recording import Recording

BLOCK = 1 << 20
"""Bytes decoded at a time, whole words of every encoding."""

_LONGEST_HEADER = 1 << 16
_DAT_CD_TYPES = (0x00, 0x0C)
_DAT_EVENT_SIZE = 8

# Sensors of recordings whose header has no size, by a part of the plugin's name.
_PLUGIN_SIZES = {
    "genx320": (320, 320),
    "imx636": (1280, 720),
    "imx646": (1280, 720),
    "gen41": (1280, 720),
    "gen4": (1280, 720),
    "gen31": (640, 480),
    "gen3": (640, 480),
}


class PropheseeRecording(Recording):
    """Events of a RAW or DAT file; it holds no calibration.

    Where neither the options nor the header give the sensor size, the whole file is read once for it.

    Raises RecordingError for a header without encoding, another event type, or an unknown encoding.
    """

    def __init__(self, path: Path, options: ReadingOptions) -> None:
        super().__init__(path, path.stat().st_size)
        with path.open("rb") as file:
            fields, self._start = _read_header(file)
            file.seek(self._start)
            self.encoding = _encoding(fields)
            if self.encoding == "dat":
                _check_dat_type(file.read(2))
                self._start += 2
        self.format = "Prophesee DAT" if self.encoding == "dat" else f"Prophesee RAW, {self.encoding}"
        self._read = self._start
        size = _size(fields) or options.size
        decoder(self.encoding, *(size or (1, 1)))
        self.width, self.height = size or self._size_of_events()
        self.size_inferred = size is None

    def progress(self) -> float:
        """Fraction of the bytes read."""
        return self._read / self.size_bytes

    def _packets(self) -> Iterator[EventArray]:
        events_of = decoder(self.encoding, self.width, self.height)
        self.statistics.decoder = events_of.statistics
        self._read = self._start
        with self.path.open("rb") as file:
            file.seek(self._start)
            while block := file.read(BLOCK):
                self.statistics.packets += 1
                self._read = file.tell()
                yield from events_of.decode_parts(block)


def has_format(path: Path) -> bool:
    """Whether the header of a file that begins with % names a format of Prophesee's, rather than standing over a text.

    Raises RecordingError for a header without an end.
    """
    with path.open("rb") as file:
        fields, _ = _read_header(file)
    return not fields.keys().isdisjoint(("format", "evt", "version"))


def _read_header(file: BinaryIO) -> tuple[dict[str, str], int]:
    """Return the fields of the `% key value` lines, keys in lower case, and the position after them."""
    fields: dict[str, str] = {}
    start = file.read(_LONGEST_HEADER)
    position = 0
    while start.startswith(b"% ", position):
        end = start.find(b"\n", position)
        if end < 0:
            raise RecordingError("the header of % lines has no end")
        key, _, value = start[position + 2 : end].decode("latin-1").strip().partition(" ")
        position = end + 1
        if key.lower() == "end":
            break
        fields[key.lower()] = value.strip()
    return fields, position


def _encoding(fields: dict[str, str]) -> str:
    name, _, detail = fields.get("format", "").lower().partition(";")
    if not name and "evt" in fields:
        name = "evt" + fields["evt"].removesuffix(".0").replace("2.1", "21")
    if name == "evt21" and "endianness=legacy" in detail.split(";"):
        return "evt21_legacy"
    if name:
        return name
    if "version" in fields:
        return "dat"
    raise RecordingError(f"the header names no event format (it has {', '.join(fields) or 'no fields'})")


def _check_dat_type(head: bytes) -> None:
    if len(head) < 2:
        raise RecordingError("the file ends after its header")
    kind, size = head
    if kind not in _DAT_CD_TYPES or size != _DAT_EVENT_SIZE:
        raise RecordingError(f"DAT events of type {kind:#04x} and {size} bytes are not pixel events of 8 bytes")


def _size(fields: dict[str, str]) -> tuple[int, int] | None:
    """Sensor size, from whichever field has it; None where none has."""
    detail = dict(item.partition("=")[::2] for item in fields.get("format", "").split(";"))
    if "geometry" in fields:
        width, _, height = fields["geometry"].partition("x")
    elif "width" in detail and "height" in detail:
        width, height = detail["width"], detail["height"]
    elif "width" in fields and "height" in fields:
        width, height = fields["width"], fields["height"]
    else:
        plugin = fields.get("plugin_name", "")
        known = [size for name, size in _PLUGIN_SIZES.items() if name in plugin]
        return known[0] if known else None
    if not (width.isdecimal() and height.isdecimal()):
        raise RecordingError(f"the header gives the sensor size {width!r} x {height!r}")
    return int(width), int(height)
