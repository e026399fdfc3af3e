"""Detection of the columns of a text from its first lines."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal

from esfo_core.codecs.text_fault import number_of
from esfo_core.codecs.text_layout import COLUMNS, TextLayout
from esfo_core.codecs.text_numbers import OFF_WORDS, ON_WORDS
from esfo_core.errors import RecordingError
from esfo_core.recordings.reading_options import ReadingOptions
from esfo_core.recordings.text_guess import likely_columns, likely_unit

_SEPARATOR = re.compile(r"[ ,;\t\r\"]+")
_GEOMETRY = re.compile(r"geometry\W+(\d+)\D+(\d+)", re.IGNORECASE)
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
_SAMPLE_LINES = 1000
_LONG_HEAD = 1000  # bytes of text without an event in it
_MARK = b"\xef\xbb\xbf"  # of the byte order, before UTF-8 of Windows


@dataclass(frozen=True)
class TextStart:
    """Layout and start of a text, from its first bytes.

    layout: of its lines. skip: bytes before the first event line. lines: how many lines these are.
    size: width and height in pixels where a line before the events gives them, else None. guesses: what was found out
    from the numbers, each with the option that says otherwise.
    """

    layout: TextLayout
    skip: int
    lines: int
    size: tuple[int, int] | None
    guesses: tuple[str, ...]


@dataclass(frozen=True)
class _Head:
    """The lines before the first event: those without comments, split; their bytes and number, and a size in them."""

    rows: list[list[str]]
    skip: int
    lines: int
    size: tuple[int, int] | None


def find_layout(start: bytes, options: ReadingOptions) -> TextStart:
    """Find the layout of a text from its first bytes (whole lines of them are looked at).

    Columns come from the options, else from a line of names, else from the numbers (`likely_columns`). The unit comes
    from the options, else from the name of the time column (`t_us`), else from the numbers (`likely_unit`).

    Raises RecordingError for text that is no table of events, or one that leaves the columns or the unit open.
    """
    head = _head(start)
    sample = _sample(start[head.skip :])
    first = start[head.skip :].partition(b"\n")[0]
    unit, guesses, unread = "", [], head.rows
    if options.columns:
        names = tuple(options.columns.replace(" ", "").split(","))
    elif head.rows and len(head.rows[-1]) >= len(COLUMNS):
        names, unit = _named_columns(head.rows[-1])
        unread = head.rows[:-1]
    else:
        names = likely_columns(sample, b"," in first)
        guesses.append(f"columns {','.join(names)} (option columns)")
    if any(len(row) != len(names) for row in sample[:1]):
        raise RecordingError(f"the first line of numbers has {len(sample[0])} columns, not {','.join(names)}")
    unit = options.time_unit or unit
    if not unit:
        unit = likely_unit([row[names.index("t")] for row in sample if "t" in names and len(row) == len(names)])
        guesses.append(f"time in {unit} (option time_unit)")
    if unread:
        guesses.append(f"{len(unread)} lines before the events hold none: {' '.join(unread[0])[:40]!r} ...")
    return TextStart(TextLayout(names, unit), head.skip, head.lines, head.size, tuple(guesses))


def _head(start: bytes) -> _Head:
    rows: list[list[str]] = []
    size = None
    position, lines = len(_MARK) * start.startswith(_MARK), 0
    while position < len(start):
        end = start.find(b"\n", position)
        end = len(start) if end < 0 else end
        line = start[position:end].decode("utf-8", "replace").strip()
        fields = _fields(line)
        geometry = _GEOMETRY.search(line)
        if geometry:
            size = (int(geometry[1]), int(geometry[2]))
        elif fields and not line.startswith(("#", "%")):
            if len(fields) >= len(COLUMNS) and sum(_value(field) is not None for field in fields) >= len(COLUMNS):
                return _Head(rows, position, lines, size)
            if not rows and len(fields) == 2 and all(field.isdecimal() for field in fields):
                size = (int(fields[0]), int(fields[1]))
            else:
                rows.append(fields)
        position, lines = end + 1, lines + 1
    if rows and len(start) >= _LONG_HEAD:
        raise RecordingError(f"text of no known form; its first line is {' '.join(rows[0])[:60]!r}")
    raise RecordingError(f"text without a line of events; it starts with {start[:40].decode('ascii', 'replace')!r}")


def _fields(line: str) -> list[str]:
    return [field for field in _SEPARATOR.split(line) if field]


def _sample(data: bytes) -> list[list[Decimal]]:
    """Numbers of the first lines, as far as they are numbers; the decoder tells of the others."""
    rows = []
    for line in data.decode("ascii", "replace").split("\n")[:-1][:_SAMPLE_LINES] or [data.decode("ascii", "replace")]:
        numbers = [_value(field) for field in _fields(line.strip())]
        row = [number for number in numbers if number is not None]
        if len(row) == len(numbers) >= len(COLUMNS):
            rows.append(row)
    return rows


def _value(field: str) -> Decimal | None:
    """A number, or a polarity in words as one."""
    word = field.lower()
    return Decimal(word in ON_WORDS) if word in (*ON_WORDS, *OFF_WORDS) else number_of(field)


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
