"""Events as text: one per line, numbers between commas, semicolons, spaces or tabs.

A number is a sign, digits, a decimal point and an exponent, as printf and NumPy write them. Its value is computed in
whole numbers, never as float64, which resolves a time of 2023 in seconds to 238 ns only. Times are rounded to the
nearest nanosecond. Polarity is 1 for on and 0 or -1 for off; one stream uses one of the two. Blank lines and lines
that start with # hold no event.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from esfo_core.codecs.base import Bytes
from esfo_core.codecs.state_machine import StateDecoder
from esfo_core.codecs.text_kernels import NEWLINE, decode_lines
from esfo_core.errors import RecordingError
from esfo_core.events import EVENT_DTYPE, EventArray

COLUMNS = ("x", "y", "p", "t")
"""Columns that a text of events must have."""

UNIT_POWERS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
"""Units of time, as powers of ten in nanoseconds."""

LONGEST_LINE = 4096
"""Most bytes in a line of events."""


@dataclass(frozen=True)
class TextLayout:
    """Columns and unit of the lines of a text.

    columns: name of each, those of `COLUMNS` once each and others, which are skipped. time_unit: s, ms, us or ns.
    """

    columns: tuple[str, ...]
    time_unit: str

    def __post_init__(self) -> None:
        if any(self.columns.count(name) != 1 for name in COLUMNS):
            raise RecordingError(f"columns are {','.join(self.columns)!r}; needed are x, y, p and t, once each")
        if self.time_unit not in UNIT_POWERS:
            raise RecordingError(f"time unit is {self.time_unit!r}; choose from {', '.join(UNIT_POWERS)}")


class TextDecoder(StateDecoder):
    """Decodes text in pieces cut anywhere; `finish` decodes what the last piece left open.

    line: number of the line to come, from 1; set it where the pieces do not begin with the file.
    """

    word = np.dtype("u1")
    state_size = 0

    def __init__(self, layout: TextLayout, width: int, height: int) -> None:
        super().__init__(width, height)
        self.layout = layout
        self.line = 1
        self._roles = np.array([COLUMNS.index(c) if c in COLUMNS else -1 for c in layout.columns], np.int64)
        self._open_line = b""
        self._latest: int | None = None  # ns

    def decode_parts(self, data: Bytes, time_base: int = 0) -> list[EventArray]:
        """Decode the lines that end in `data`, as `Decoder.decode_parts`.

        Raises RecordingError with the line for one that is no event, and for one longer than `LONGEST_LINE`.
        """
        whole, newline, rest = bytes(data).rpartition(b"\n")
        if newline:
            whole, self._open_line = self._open_line + whole + newline, rest
        else:
            self._open_line += rest
        if len(self._open_line) > LONGEST_LINE:
            raise RecordingError(f"line {self.line} is longer than {LONGEST_LINE} bytes")
        parts = super().decode_parts(whole, time_base)
        if len(parts[-1]):
            self._latest = int(parts[-1]["t"][-1])
        return parts

    def finish(self) -> tuple[EventArray, int]:
        """Decode the last line where it has no end.

        Returns its event and the number of bytes lost: those of a line that is not whole, or whose time is before the
        last one, as where the digits of a time are cut off.
        """
        line, self._open_line = self._open_line, b""
        try:
            t = self._latest
            events = self.decode(line + b"\n")
        except RecordingError:
            return np.empty(0, EVENT_DTYPE), len(line)
        if len(events) and t is not None and events["t"][0] < t:
            self.statistics.events -= 1
            return events[:0], len(line)
        return events, 0

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        lines = int(np.count_nonzero(words == NEWLINE))
        events = np.empty(lines, EVENT_DTYPE)
        power = UNIT_POWERS[self.layout.time_unit]
        n, read, bad = decode_lines(words, self._roles, power, self._state, events)
        self.line += read
        if bad >= 0:
            text = bytes(words[bad : bad + 60]).partition(b"\n")[0].decode("ascii", "replace").strip()
            raise RecordingError(
                f"line {self.line} is no event of {','.join(self.layout.columns)} with time in "
                f"{self.layout.time_unit}: {text!r}"
            )
        self._count(self.triggers)
        return events[:n]
