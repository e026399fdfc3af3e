"""What is wrong with a line of text that is no event, in the words of who wrote it."""

from __future__ import annotations

import re
from decimal import Decimal, InvalidOperation

from esfo_core.codecs.text_layout import UNIT_POWERS, TextLayout
from esfo_core.codecs.text_numbers import MAX_TIME, OFF_WORDS, ON_WORDS

_SEPARATOR = re.compile(r"[ ,;\t\r\"]+")
_MAX_PIXEL = 2**16 - 1


def fault_of(line: str, layout: TextLayout) -> str:
    """Return why `line` is no event of the layout: the field and what it should be."""
    fields = [field for field in _SEPARATOR.split(line) if field]
    if len(fields) != len(layout.columns):
        return f"{len(fields)} fields, not {len(layout.columns)}: {line[:60]!r}"
    for name, field in zip(layout.columns, fields, strict=True):
        wanted = _wanted(name, field, UNIT_POWERS[layout.time_unit])
        if wanted:
            return f"{name} is {field[:40]!r}, not {wanted}: {line[:60]!r}"
    return f"p is 0 and -1 for off in one text, so that it is not known what they mean: {line[:60]!r}"


def _wanted(name: str, field: str, power: int) -> str:
    """What the column `name` should hold, empty where the field does."""
    number = number_of(field)
    if name == "p":
        return "" if number in (-1, 0, 1) or field.lower() in (*ON_WORDS, *OFF_WORDS) else "0, 1, -1, true or false"
    if name in ("x", "y"):
        good = number is not None and number == number.to_integral_value() and 0 <= number <= _MAX_PIXEL
        return "" if good else f"a whole number from 0 to {_MAX_PIXEL}"
    if name == "t":
        return "" if number is not None and 0 <= number * 10**power <= MAX_TIME else "a time from 0 s to 146 years"
    return ""


def number_of(field: str) -> Decimal | None:
    """Return the finite number that a field holds, None where it holds none."""
    try:
        number = Decimal(field)
    except InvalidOperation:
        return None
    return number if "_" not in field and number.is_finite() and abs(number.adjusted()) < 1000 else None
