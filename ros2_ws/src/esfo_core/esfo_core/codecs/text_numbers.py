"""Numbers in a text, read as whole numbers: float64 resolves a time of 2023 in seconds to 238 ns only."""

from __future__ import annotations

import numpy as np
from numba import njit

IS_SEPARATOR = np.isin(np.arange(256), [ord(c) for c in ' ,;\t\r"'])
"""What may stand between values; quotes around them count as that."""

P, T = 2, 3
"""Polarity and time among the columns x, y, p, t."""

MAX_TIME = 2**62

_NEWLINE, _MINUS, _PLUS, _POINT = (ord(c) for c in "\n-+.")
_ZERO, _NINE, _LOWER_E, _UPPER_E = (ord(c) for c in "09eE")
_IS_DIGIT = np.isin(np.arange(256), [ord(c) for c in "0123456789"])
_IS_LETTER = np.isin(np.arange(256) | 32, np.arange(ord("a"), ord("z") + 1)) & (np.arange(256) >= ord("A"))
_ROOM_FOR_DIGIT = (2**63 - 10) // 10  # a number up to this takes one more digit in int64
_MAX_EXPONENT = 10_000  # larger ones are cut to this: none of both fits
_TENS = 10 ** np.arange(19, dtype=np.int64)
_HIGHEST = np.array([2**16 - 1, 2**16 - 1, 1, MAX_TIME])  # by column

ON_WORDS, OFF_WORDS = ("true", "on"), ("false", "off")
"""Polarities in words, in any case."""


def _code(word: str) -> int:
    """A number for a word of at most five letters, as `_read_word` computes it."""
    return int(np.polyval([ord(letter) - ord("`") for letter in word], 32))


_TRUE, _ON, _FALSE, _OFF = (_code(word) for word in (*ON_WORDS, *OFF_WORDS))


@njit(cache=True, nogil=True, inline="always")
def read_value(data, i, role, power):  # type: ignore[no-untyped-def]
    """Read the number at `i`; return whether it is a value of the column `role`, the value, and where it ends."""
    if role == P and _IS_LETTER[data[i]]:
        return _read_word(data, i)
    negative, mantissa, scale, up, end = _read_number(data, i)
    if end == i or (data[end] != _NEWLINE and not IS_SEPARATOR[data[end]]):
        return False, np.int64(0), end
    value = _rounded(mantissa, scale + power, up) if role == T else _whole(mantissa, scale)
    good = 0 <= value <= _HIGHEST[role] and (not negative or value == 0 or role == P)
    return good, -value if negative else value, end


@njit(cache=True, nogil=True)
def _read_word(data, i):  # type: ignore[no-untyped-def]
    """Read the word at `i`; return whether it is a polarity, the polarity, and where the word ends."""
    code, start = np.int64(0), i
    while _IS_LETTER[data[i]]:
        code = code * 32 + ((np.int64(data[i]) | 32) - 96) if i - start < 5 else np.int64(-1)
        i += 1
    on, off = code in (_TRUE, _ON), code in (_FALSE, _OFF)
    ends = data[i] == _NEWLINE or IS_SEPARATOR[data[i]]
    return ends and (on or off), np.int64(on), i


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
    if power >= len(_TENS) or (power >= 0 and mantissa > MAX_TIME // _TENS[power]):
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
