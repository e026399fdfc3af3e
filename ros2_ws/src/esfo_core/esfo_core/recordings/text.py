"""Recordings as text: TOPSPIN's `x,y,p,t`, the Event Camera Dataset's `t x y p`, and other orders of columns."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from esfo_core.codecs.text import TextDecoder
from esfo_core.errors import RecordingError
from esfo_core.events import EventArray
from esfo_core.recordings.byte_stream import ByteStream
from esfo_core.recordings.reading_options import ReadingOptions
from esfo_core.recordings.recording import Recording
from esfo_core.recordings.text_layout import find_layout

_HEAD = 1 << 16


class TextRecording(Recording):
    """Events of a text file, plain or compressed as .gz, .zip or .zst; it holds no calibration.

    Where neither the options nor its first line give the sensor size, the whole file is read once for it.

    Raises RecordingError for text of no known layout, and for bad lines where the file is read for its size.
    """

    def __init__(self, path: Path, options: ReadingOptions) -> None:
        super().__init__(path, path.stat().st_size)
        self._stream = ByteStream(path)
        self._start = find_layout(self._head(), options)
        self.encoding = "text"
        self.guesses = self._start.guesses
        size = self._start.size or options.size
        self.width, self.height = size or self._size_of_events()
        self.size_inferred = size is None
        layout = self._start.layout
        self.format = f"text, {','.join(layout.columns)} in {layout.time_unit}"

    def progress(self) -> float:
        """Fraction of the bytes read."""
        return min(1.0, self._stream.position / self.size_bytes)

    def _packets(self) -> Iterator[EventArray]:
        decoder = TextDecoder(self._start.layout, self.width, self.height)
        decoder.line += self._start.lines
        self.statistics.decoder = decoder.statistics
        skip = self._start.skip
        for block in self._stream.blocks():
            self.statistics.packets += 1
            data, skip = block[skip:], max(0, skip - len(block))
            yield from decoder.decode_parts(data)
            self.statistics.first_fault = decoder.first_fault
        events, lost = decoder.finish()
        self.statistics.bytes_lost = max(lost, int(self._stream.cut))
        yield events

    def _head(self) -> bytes:
        head = b""
        for block in self._stream.blocks():
            head += block
            if len(head) >= _HEAD:
                break
        if not head:
            raise RecordingError("the compressed file is empty")
        return head[:_HEAD]
