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
from numba import njit
from numpy.typing import NDArray

from esfo_core.codecs.base import Bytes
from esfo_core.codecs.state_machine import HEIGHT, OUT_OF_RANGE, WIDTH, StateDecoder
from esfo_core.codecs.state_machine import SEEN as POLARITIES  # bits: 1 for a zero, 2 for -1
from esfo_core.errors import RecordingError
from esfo_core.events import EVENT_DTYPE, EventArray

COLUMNS = ("x", "y", "p", "t")
"""Columns that a text of events must have."""

UNIT_POWERS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
"""Units of time, as powers of ten in nanoseconds."""

LONGEST_LINE = 4096
"""Bytes; what has no end within these is no line of events."""

_EVENT, _NOTHING, _BAD = range(3)
_NEWLINE, _COMMENT, _MINUS, _PLUS, _POINT = (ord(c) for c in "\n#-+.")
_ZERO, _NINE, _LOWER_E, _UPPER_E = (ord(c) for c in "09eE")
_IS_SEPARATOR = np.isin(np.arange(256), [ord(c) for c in " ,;\t\r"])
_IS_DIGIT = np.isin(np.arange(256), [ord(c) for c in "0123456789"])
_MAX_TIME = 2**62
_ROOM_FOR_DIGIT = (2**63 - 10) // 10  # a number up to this takes one more digit in int64
_MAX_EXPONENT = 10_000  # larger ones are cut to this: none of both fits
_TENS = 10 ** np.arange(19, dtype=np.int64)
_X, _Y, _P, _T = range(4)
_HIGHEST = np.array([2**16 - 1, 2**16 - 1, 1, _MAX_TIME])  # by column


@dataclass(frozen=True)
class TextLayout:
    """What the lines of a text hold.

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
        lines = int(np.count_nonzero(words == _NEWLINE))
        events = np.empty(lines, EVENT_DTYPE)
        power = UNIT_POWERS[self.layout.time_unit]
        n, read, bad = _decode_lines(words, self._roles, power, self._state, events)
        self.line += read
        if bad >= 0:
            text = bytes(words[bad : bad + 60]).partition(b"\n")[0].decode("ascii", "replace").strip()
            raise RecordingError(
                f"line {self.line} is no event of {','.join(self.layout.columns)} with time in "
                f"{self.layout.time_unit}: {text!r}"
            )
        self._count(self.triggers)
        return events[:n]


@njit(cache=True, nogil=True)
def _decode_lines(data, roles, power, state, events):  # type: ignore[no-untyped-def]
    """Decode `data` (M,), whole lines; return the numbers of events and of lines, and where a bad line starts or -1."""
    values = np.empty(4, np.int64)
    i = n = lines = 0
    while i < len(data):
        start = i
        kind, i = _read_line(data, i, roles, power, values)
        if kind == _EVENT:
            x, y, p, t = values
            state[POLARITIES] |= 1 if p == 0 else (2 if p < 0 else 0)
            if state[POLARITIES] == 3:  # 0 and -1 both: no knowing what they mean
                return n, lines, start
            if x >= state[WIDTH] or y >= state[HEIGHT]:
                state[OUT_OF_RANGE] += 1
            else:
                events[n].x, events[n].y, events[n].p, events[n].t = x, y, p > 0, t
                n += 1
        elif kind == _BAD:
            return n, lines, start
        lines += 1
    return n, lines, -1


@njit(cache=True, nogil=True)
def _read_line(data, i, roles, power, values):  # type: ignore[no-untyped-def]
    """Read the line at `i` into `values` (x, y, p, t); return what it is and where the next one starts."""
    while _IS_SEPARATOR[data[i]]:
        i += 1
    if data[i] == _NEWLINE or data[i] == _COMMENT:
        while data[i] != _NEWLINE:
            i += 1
        return _NOTHING, i + 1
    column = 0
    while data[i] != _NEWLINE:
        if column == len(roles):
            return _BAD, i
        role = roles[column]
        if role < 0:
            while data[i] != _NEWLINE and not _IS_SEPARATOR[data[i]]:
                i += 1
        else:
            good, values[role], i = _read_value(data, i, role, power)
            if not good:
                return _BAD, i
        while _IS_SEPARATOR[data[i]]:
            i += 1
        column += 1
    return (_EVENT if column == len(roles) else _BAD), i + 1


@njit(cache=True, nogil=True, inline="always")
def _read_value(data, i, role, power):  # type: ignore[no-untyped-def]
    """Read the number at `i`; return whether it is a value of the column `role`, the value, and where it ends."""
    negative, mantissa, scale, up, end = _read_number(data, i)
    if end == i or (data[end] != _NEWLINE and not _IS_SEPARATOR[data[end]]):
        return False, np.int64(0), end
    value = _rounded(mantissa, scale + power, up) if role == _T else _whole(mantissa, scale)
    good = 0 <= value <= _HIGHEST[role] and (not negative or value == 0 or role == _P)
    return good, -value if negative else value, end


@njit(cache=True, nogil=True, inline="always")
def _read_number(data, i):  # type: ignore[no-untyped-def]
    """Read sign, digits, point and exponent at `i`.

    Returns whether it is negative, its mantissa and power of ten, whether the digits that the mantissa has no room for
    round up, and where it ends: at `i` where no number is.
    """
    start, negative = i, data[i] == _MINUS
    if negative or data[i] == _PLUS:
        i += 1
    first, mantissa, scale, up = i, np.int64(0), np.int64(0), np.int64(0)
    while _IS_DIGIT[data[i]] and mantissa <= _ROOM_FOR_DIGIT:
        mantissa = mantissa * 10 + (np.int64(data[i]) - _ZERO)
        i += 1
    digits = i - first
    full = _IS_DIGIT[data[i]]
    if full:
        up = np.int64(data[i] >= _ZERO + 5)
    while _IS_DIGIT[data[i]]:
        scale += 1
        i += 1
    if data[i] == _POINT:
        i += 1
        first = i
        while _IS_DIGIT[data[i]] and mantissa <= _ROOM_FOR_DIGIT:
            mantissa = mantissa * 10 + (np.int64(data[i]) - _ZERO)
            i += 1
        digits += i - first
        scale -= i - first
        if not full:
            up = np.int64(_ZERO + 5 <= data[i] <= _NINE)
        while _IS_DIGIT[data[i]]:
            i += 1
    if digits:
        exponent, i = _read_exponent(data, i)
        scale += exponent
    return negative, mantissa, scale, up, i if digits else start


@njit(cache=True, nogil=True, inline="always")
def _read_exponent(data, i):  # type: ignore[no-untyped-def]
    """Read e and a signed whole number at `i`; return it and where it ends, 0 and `i` where none is."""
    start, value = i, np.int64(0)
    if data[i] != _LOWER_E and data[i] != _UPPER_E:
        return value, start
    i += 1
    negative = data[i] == _MINUS
    if negative or data[i] == _PLUS:
        i += 1
    first = i
    while _IS_DIGIT[data[i]]:
        value = min(value * 10 + (data[i] - _ZERO), np.int64(_MAX_EXPONENT))
        i += 1
    if i == first:
        return value, start
    return (-value if negative else value), i


@njit(cache=True, nogil=True)
def _rounded(mantissa, power, up):  # type: ignore[no-untyped-def]
    """Return mantissa * 10 ** power to the nearest, -1 where it is too large; `up` decides where power is 0."""
    if mantissa == 0 or -power >= len(_TENS):
        return np.int64(0)
    if power >= len(_TENS) or (power >= 0 and mantissa > _MAX_TIME // _TENS[power]):
        return np.int64(-1)
    if power >= 0:
        return mantissa * _TENS[power] + (up if power == 0 else 0)
    divisor = _TENS[-power]
    rest = mantissa % divisor
    return mantissa // divisor + (rest >= divisor - rest)


@njit(cache=True, nogil=True)
def _whole(mantissa, power):  # type: ignore[no-untyped-def]
    """Return mantissa * 10 ** power, -1 where it is not whole or too large."""
    if power < 0 and mantissa > 0 and (-power >= len(_TENS) or mantissa % _TENS[-power]):
        return np.int64(-1)
    return _rounded(mantissa, power, 0)
