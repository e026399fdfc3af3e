"""Events as text: one per line, numbers between commas, semicolons, spaces or tabs.

A number is a sign, digits, a decimal point and an exponent, as printf and NumPy write them, with quotes around it or
without. Times are rounded to the nearest nanosecond. Polarity is 1 for on and 0 or -1 for off, where one stream uses
one of the two, or true and false. Blank lines and lines that start with # or % hold no event.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.codecs.base import Bytes
from esfo_core.codecs.state_machine import HEIGHT, OUT_OF_RANGE, WIDTH, StateDecoder
from esfo_core.codecs.state_machine import SEEN as POLARITIES  # bits: 1 for a zero, 2 for -1
from esfo_core.codecs.text_fault import fault_of
from esfo_core.codecs.text_layout import COLUMNS, UNIT_POWERS, TextLayout
from esfo_core.codecs.text_numbers import IS_SEPARATOR, read_value
from esfo_core.errors import RecordingError
from esfo_core.events import EVENT_DTYPE, EventArray

LONGEST_LINE = 4096
"""Bytes; what has no end within these is no line of events."""

LINES_PER_BAD_ONE = 100
"""A line that is no event is skipped and counted where so many lines come on it; more of them are no damage."""

_JUDGED_LINES = 1000  # before so many have come, their share is judged at the end

_EVENT, _NOTHING, _BAD = range(3)
_BOTH = 3  # 0 and -1
_NEWLINE = ord("\n")
_IS_COMMENT = np.isin(np.arange(256), [ord(c) for c in "#%"])


class TextDecoder(StateDecoder):
    """Decodes text in pieces cut anywhere; `finish` decodes what the last piece left open.

    line: number of the line to come, from 1; set it where the pieces do not begin with the file. first_fault: what is
    wrong with the first line that was skipped, empty where none was.
    """

    word = np.dtype("u1")
    state_size = 0

    def __init__(self, layout: TextLayout, width: int, height: int) -> None:
        super().__init__(width, height)
        self.layout = layout
        self.line = 1
        self.first_fault = ""
        self._roles = np.array([COLUMNS.index(c) if c in COLUMNS else -1 for c in layout.columns], np.int64)
        self._open_line = b""
        self._latest: int | None = None  # ns

    def decode_parts(self, data: Bytes, time_base: int = 0) -> list[EventArray]:
        """Decode the lines that end in `data`, as `Decoder.decode_parts`.

        Lines that are no events are skipped and counted, as long as they are few. Raises RecordingError with the first
        of them where they are more than one in `LINES_PER_BAD_ONE`, and for a line longer than `LONGEST_LINE`.
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
        last one, as where the digits of a time are cut off. Raises RecordingError where too many lines are no events.
        """
        line, self._open_line = self._open_line, b""
        t, bad, fault = self._latest, self.statistics.bad_lines, self.first_fault
        events = self.decode(line + b"\n")
        lost = self.statistics.bad_lines > bad or (len(events) > 0 and t is not None and int(events["t"][0]) < t)
        self.statistics.bad_lines, self.first_fault = bad, fault
        self._refuse_if_most(self.line - 1)
        if lost:
            self.statistics.events -= len(events)
            return np.empty(0, EVENT_DTYPE), len(line)
        return events, 0

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        lines = int(np.count_nonzero(words == _NEWLINE))
        events = np.empty(lines, EVENT_DTYPE)
        power = UNIT_POWERS[self.layout.time_unit]
        n, bad, first_bad = _decode_lines(words, self._roles, power, self._state, events)
        if bad:
            self._take_bad(words, bad, first_bad)
        self.line += lines
        self._refuse_if_most(max(self.line - 1, _JUDGED_LINES))
        self._count(self.triggers)
        return events[:n]

    def _take_bad(self, words: NDArray[Any], count: int, first: int) -> None:
        """Count the lines that are no events, the first of which begins at `first`."""
        before = int(np.count_nonzero(words[:first] == _NEWLINE))
        text = bytes(words[first : first + LONGEST_LINE]).partition(b"\n")[0].decode("utf-8", "replace").strip()
        self.first_fault = self.first_fault or f"line {self.line + before}: {fault_of(text, self.layout)}"
        self.statistics.bad_lines += count

    def _refuse_if_most(self, lines: int) -> None:
        if self.statistics.bad_lines * LINES_PER_BAD_ONE > lines:
            raise RecordingError(
                f"{self.first_fault} (read as {','.join(self.layout.columns)} with time in {self.layout.time_unit}; "
                "the options columns and time_unit say otherwise)"
            )


@njit(cache=True, nogil=True)
def _decode_lines(data, roles, power, state, events):  # type: ignore[no-untyped-def]
    """Decode `data` (M,), whole lines; return the numbers of events and bad lines, and the first bad one."""
    values = np.empty(4, np.int64)
    i = n = bad = 0
    first_bad = -1
    while i < len(data):
        start = i
        kind, i = _read_line(data, i, roles, power, values)
        x, y, p, t = values
        if kind == _EVENT:
            sign = 1 if p == 0 else (2 if p < 0 else 0)
            if state[POLARITIES] | sign == _BOTH:  # no knowing what they mean
                kind = _BAD
            else:
                state[POLARITIES] |= sign
        if kind == _EVENT and (x >= state[WIDTH] or y >= state[HEIGHT]):
            state[OUT_OF_RANGE] += 1
        elif kind == _EVENT:
            events[n].x, events[n].y, events[n].p, events[n].t = x, y, p > 0, t
            n += 1
        elif kind == _BAD:
            first_bad = start if bad == 0 else first_bad
            bad += 1
            i = start
            while data[i] != _NEWLINE:
                i += 1
            i += 1
    return n, bad, first_bad


@njit(cache=True, nogil=True)
def _read_line(data, i, roles, power, values):  # type: ignore[no-untyped-def]
    """Read the line at `i` into `values` (x, y, p, t); return what it is and where the next one starts."""
    while IS_SEPARATOR[data[i]]:
        i += 1
    if data[i] == _NEWLINE or _IS_COMMENT[data[i]]:
        while data[i] != _NEWLINE:
            i += 1
        return _NOTHING, i + 1
    column = 0
    while data[i] != _NEWLINE:
        if column == len(roles):
            return _BAD, i
        role = roles[column]
        if role < 0:
            while data[i] != _NEWLINE and not IS_SEPARATOR[data[i]]:
                i += 1
        else:
            good, values[role], i = read_value(data, i, role, power)
            if not good:
                return _BAD, i
        while IS_SEPARATOR[data[i]]:
            i += 1
        column += 1
    return (_EVENT if column == len(roles) else _BAD), i + 1
