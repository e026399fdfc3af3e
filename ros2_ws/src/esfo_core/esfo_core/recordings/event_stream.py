"""Event Stream files (`.es`, version 2) of DVS events."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from esfo_core.codecs.event_stream import EventStreamDecoder
from esfo_core.errors import RecordingError
from esfo_core.events import EventArray
from esfo_core.recordings.recording import Recording

MAGIC = b"Event Stream"

_BLOCK = 1 << 20
_HEADER = 20  # bytes: magic, version, kind, width, height
_VERSION, _DVS = 2, 1


class EventStreamRecording(Recording):
    """Events of an Event Stream file; it holds no calibration.

    Raises RecordingError for another version, and for a file of other events than DVS ones.
    """

    encoding = "event_stream"

    def __init__(self, path: Path) -> None:
        super().__init__(path, path.stat().st_size)
        with path.open("rb") as file:
            header = file.read(_HEADER)
        if len(header) < _HEADER:
            raise RecordingError("the file ends in its header")
        version, kind = header[12:15], header[15]
        if version[0] != _VERSION:
            raise RecordingError(f"Event Stream of version {'.'.join(map(str, version))}; only version 2 is read")
        if kind != _DVS:
            raise RecordingError(f"Event Stream of kind {kind}; only DVS events (1) are read")
        self.width, self.height = (int.from_bytes(header[at : at + 2], "little") for at in (16, 18))
        self.format = "Event Stream, DVS"
        EventStreamDecoder(self.width, self.height)
        self._read = _HEADER

    def progress(self) -> float:
        """Fraction of the bytes read."""
        return self._read / self.size_bytes

    def _packets(self) -> Iterator[EventArray]:
        decoder = EventStreamDecoder(self.width, self.height)
        self.statistics.decoder = decoder.statistics
        with self.path.open("rb") as file:
            file.seek(_HEADER)
            while block := file.read(_BLOCK):
                self.statistics.packets += 1
                self._read = file.tell()
                yield from decoder.decode_parts(block)
