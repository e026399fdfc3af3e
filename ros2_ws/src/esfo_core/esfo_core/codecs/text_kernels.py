"""Kernels of the text decoder: lines of decimal numbers to events.

Everything that `decode_lines` calls is in this file: numba does not compile a cached kernel anew when another file
changes.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from esfo_core.codecs.state_machine import HEIGHT, OUT_OF_RANGE, WIDTH
from esfo_core.codecs.state_machine import SEEN as POLARITIES  # bits: 1 for a zero, 2 for -1

_EVENT, _NOTHING, _BAD = range(3)
NEWLINE, _COMMENT, _MINUS, _PLUS, _POINT = (ord(c) for c in "\n#-+.")
_ZERO, _NINE, _LOWER_E, _UPPER_E = (ord(c) for c in "09eE")
_IS_SEPARATOR = np.isin(np.arange(256), [ord(c) for c in " ,;\t\r"])
_IS_DIGIT = np.isin(np.arange(256), [ord(c) for c in "0123456789"])
_MAX_TIME = 2**62
_ROOM_FOR_DIGIT = (2**63 - 10) // 10  # a number up to this takes one more digit in int64
_MAX_EXPONENT = 10_000  # larger ones are set to this: neither fits the range of times
_TENS = 10 ** np.arange(19, dtype=np.int64)
_X, _Y, _P, _T = range(4)
_HIGHEST = np.array([2**16 - 1, 2**16 - 1, 1, _MAX_TIME])  # by column


@njit(cache=True, nogil=True)
def decode_lines(data, roles, power, state, events):  # type: ignore[no-untyped-def]
    """Decode `data` (M,), whole lines; return the numbers of events and of lines, and where a bad line starts or -1."""
    values = np.empty(4, np.int64)
    i = n = lines = 0
    while i < len(data):
        start = i
        kind, i = _read_line(data, i, roles, power, values)
        if kind == _EVENT:
            x, y, p, t = values
            state[POLARITIES] |= 1 if p == 0 else (2 if p < 0 else 0)
            if state[POLARITIES] == 3:  # 0 and -1 in one stream: their meaning is ambiguous
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
    if data[i] == NEWLINE or data[i] == _COMMENT:
        while data[i] != NEWLINE:
            i += 1
        return _NOTHING, i + 1
    column = 0
    while data[i] != NEWLINE:
        if column == len(roles):
            return _BAD, i
        role = roles[column]
        if role < 0:
            while data[i] != NEWLINE and not _IS_SEPARATOR[data[i]]:
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
    if end == i or (data[end] != NEWLINE and not _IS_SEPARATOR[data[end]]):
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
