"""Detection of the columns of a text from its first lines."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation

from esfo_core.codecs.text import TextLayout
from esfo_core.errors import RecordingError
from esfo_core.recordings.reading_options import ReadingOptions

_SEPARATOR = re.compile(r"[ ,;\t\r]+")
_WORD = re.compile(r"[A-Za-zµ]+")

_NAMES = {
    "x": ("x", "col", "column"),
    "y": ("y", "row"),
    "p": ("p", "pol", "polarity", "polarities", "on"),
    "t": ("t", "ts", "time", "times", "timestamp", "timestamps"),
}
_UNITS = {
    "s": ("s", "sec", "seconds"),
    "ms": ("ms", "milliseconds"),
    "us": ("us", "µs", "usec", "microseconds"),
    "ns": ("ns", "nsec", "nanoseconds"),
}
_POLARITIES = {Decimal(-1), Decimal(0), Decimal(1)}
_SAMPLE_LINES = 1000


@dataclass(frozen=True)
class TextStart:
    """Layout and start of a text, from its first bytes.

    layout: of its lines. skip: bytes before the first event line. lines: how many lines these are.
    size: width and height in pixels where the first line gives them, else None.
    """

    layout: TextLayout
    skip: int
    lines: int
    size: tuple[int, int] | None


def find_layout(start: bytes, options: ReadingOptions) -> TextStart:
    """Find the layout of a text from its first bytes (whole lines of them are looked at).

    Columns come from the options, else from a line of names, else from the numbers: t,x,y,p or x,y,p,t, whichever has
    polarities in its place; where both have, the first between spaces, the second between commas. The unit comes from
    the options, else from the name of the time column (`t_us`), else times with decimals are in s, others in us.

    Raises RecordingError for text that is no table of events, or one that leaves the columns or the unit open.
    """
    head, skip, lines = _head(start)
    size = None
    if len(head) == 1 and len(head[0]) == 2 and all(field.isdecimal() for field in head[0]):
        size = (int(head[0][0]), int(head[0][1]))
    elif len(head) > 1:
        raise RecordingError(f"text of no known form; its first line is {' '.join(head[0])[:60]!r}")
    sample = _sample(start[skip:])
    unit = ""
    if options.columns:
        names = tuple(options.columns.replace(" ", "").split(","))
    elif head and size is None:
        names, unit = _named_columns(head[0])
    else:
        names = _likely_columns(sample, b"," in start[skip:].partition(b"\n")[0])
    if any(len(row) != len(names) for row in sample[:1]):
        raise RecordingError(f"the first line of numbers has {len(sample[0])} columns, not {','.join(names)}")
    unit = options.time_unit or unit or _likely_unit([row[names.index("t")] for row in sample if "t" in names])
    return TextStart(TextLayout(names, unit), skip, lines, size)


def _head(start: bytes) -> tuple[list[list[str]], int, int]:
    """Return the lines before the first event, split, without comments; their bytes, and their number."""
    head: list[list[str]] = []
    position = lines = 0
    while position < len(start):
        end = start.find(b"\n", position)
        end = len(start) if end < 0 else end
        line = start[position:end].decode("utf-8-sig", "replace").strip()
        fields = _fields(line)
        if fields and not line.startswith("#"):
            if len(fields) >= 4 and all(_number(field) is not None for field in fields[:4]):
                return head, position, lines
            head.append(fields)
            if len(head) > 1:
                break
        position, lines = end + 1, lines + 1
    if len(head) > 1:
        return head, position, lines
    raise RecordingError(f"text without a line of events; it starts with {start[:40].decode('ascii', 'replace')!r}")


def _fields(line: str) -> list[str]:
    return [field for field in _SEPARATOR.split(line) if field]


def _sample(data: bytes) -> list[list[Decimal]]:
    """Numbers of the first lines, as far as they are numbers; the decoder tells of the others."""
    rows = []
    for line in data.decode("ascii", "replace").split("\n")[:-1][:_SAMPLE_LINES] or [data.decode("ascii", "replace")]:
        numbers = [_number(field) for field in _fields(line.strip())]
        row = [number for number in numbers if number is not None]
        if len(row) == len(numbers) >= 4:
            rows.append(row)
    return rows


def _number(field: str) -> Decimal | None:
    try:
        number = Decimal(field)
    except InvalidOperation:
        return None
    return number if number.is_finite() else None


def _named_columns(fields: list[str]) -> tuple[tuple[str, ...], str]:
    """Columns and time unit, or an empty text, from a line of names such as `x,y,polarity,t_us` or `t [us] x y p`."""
    columns: list[str] = []
    unit = ""
    for field in fields:
        words = [word.lower() for word in _WORD.findall(field)] or [field]
        if field[0] in "[(":  # a unit that a space parts from its name
            unit = _key(_UNITS, words[0]) if columns[-1:] == ["t"] else unit
            continue
        name = _key(_NAMES, words[0])
        if name == "t" and len(words) > 1:
            unit = _key(_UNITS, words[-1])
        columns.append(name or field)
    if any(columns.count(name) != 1 for name in _NAMES):
        raise RecordingError(
            f"the line of column names {','.join(fields)[:80]!r} does not name x, y, p and t once each"
        )
    return tuple(columns), unit


def _key(known: dict[str, tuple[str, ...]], word: str) -> str:
    return next((key for key, words in known.items() if word in words), "")


def _likely_columns(sample: list[list[Decimal]], commas: bool) -> tuple[str, ...]:
    if not sample or len(sample[0]) != 4:
        found = len(sample[0]) if sample else 0
        raise RecordingError(f"text of {found} columns without names; say which they are by the option columns")
    orders = [("x", "y", "p", "t"), ("t", "x", "y", "p")]
    if not commas:
        orders.reverse()
    for order in orders:
        place = order.index("p")
        if all(len(row) == 4 and row[place] in _POLARITIES for row in sample):
            return order
    raise RecordingError("no column of polarities where x,y,p,t or t,x,y,p have it; say them by the option columns")


def _likely_unit(times: list[Decimal]) -> str:
    if all(t.as_tuple().exponent == 0 for t in times):
        return "us"
    if any(t % 1 for t in times):
        return "s"
    raise RecordingError("times with decimals that are all zero leave their unit open; say it by the option time_unit")
