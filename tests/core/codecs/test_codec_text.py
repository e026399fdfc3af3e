"""Text against a plain decoder in decimal arithmetic, cut anywhere."""

from __future__ import annotations

from decimal import ROUND_HALF_UP, Decimal, InvalidOperation
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from esfo_core.codecs.text import UNIT_POWERS, TextDecoder, TextLayout
from esfo_core.errors import RecordingError

WIDTH, HEIGHT = 1280, 720


def rows(events):
    return [tuple(int(v) for v in row) for row in events]


def plain_event(line, layout):
    """One line slowly: an event (x, y, p, t), None for none, ValueError for what is no event."""
    fields = line.replace(",", " ").replace(";", " ").split()
    if not fields or fields[0].startswith(("#", "%")):
        return None
    if len(fields) != len(layout.columns):
        raise ValueError(line)
    row = dict(zip(layout.columns, fields, strict=True))
    try:
        x, y, p, t = (Decimal(row[name]) for name in "xypt")
    except InvalidOperation as error:
        raise ValueError(line) from error
    t = (t.scaleb(UNIT_POWERS[layout.time_unit])).quantize(Decimal(1), ROUND_HALF_UP)
    if x % 1 or y % 1 or not (0 <= x < 2**16 and 0 <= y < 2**16) or p not in (-1, 0, 1) or t < 0:
        raise ValueError(line)
    return int(x), int(y), int(p), int(t)


def plain_events(text, layout):
    events = [e for e in (plain_event(line, layout) for line in text.split("\n")) if e is not None]
    if {0, -1} <= {e[2] for e in events}:
        raise ValueError(text)
    inside = [(x, y, int(p > 0), t) for x, y, p, t in events if x < WIDTH and y < HEIGHT]
    return sorted(inside, key=lambda e: e[3]), len(events) - len(inside)


@st.composite
def line(draw):
    """A line of x y p t name; sometimes one that is no event."""
    pixel = st.integers(0, 1300)
    time = st.one_of(
        st.decimals(0, Decimal("0.04"), places=draw(st.integers(0, 17))),
        st.sampled_from(["0.0399999994", "0.0399999995", "3.99999e-2", "1E-3", "+.01", "5.e-3", "0.0000000005"]),
    )
    fields = [draw(pixel), draw(pixel), draw(st.sampled_from([0, 1, 1, -1])), draw(time), draw(st.sampled_from("a#"))]
    fields = [str(field) for field in fields]
    if draw(st.integers(0, 9)) == 0:
        bad = draw(st.sampled_from(["", "x", "-1.5", "1.5", "70000", "2", "1e", "1e99", "--1", "1-", ".", "1 2"]))
        fields[draw(st.integers(0, 2))] = bad
    if draw(st.integers(0, 19)) == 0:
        fields[3] = draw(st.sampled_from(["", "t", "-0.01", "1e", "1e99", "--1", "0-", "..1", ".", "0 0"]))
    text = draw(st.sampled_from([",", " ", "\t", " , ", ";"])).join(fields)
    return draw(st.sampled_from(["{}", "{}", "  {}", "{}\r", "# {}"])).format(text)


LAYOUT = TextLayout(("x", "y", "p", "t", "name"), "s")


@settings(max_examples=300, deadline=None)
@given(st.lists(line(), max_size=12), st.lists(st.integers(0, 400), max_size=6))
@example(["1 2 -1 0.1 a", "1 2 0 0.1 a"], [])
@example(["1 2 1 1e99 a"], [])
def test_decoder_equals_the_plain_one(lines, cuts):
    text = "".join(f"{line}\n" for line in lines)
    try:
        expected, outside = plain_events(text, LAYOUT)
    except (ValueError, InvalidOperation):
        expected = None
    d, found = TextDecoder(LAYOUT, WIDTH, HEIGHT), []
    borders = [0, *sorted(min(cut, len(text)) for cut in cuts), len(text)]
    pieces = [text[a:b].encode() for a, b in pairwise(borders)]
    if expected is None:
        [d.decode(piece) for piece in pieces]
        with pytest.raises(RecordingError, match=r"line \d+: .*options columns and time_unit"):
            d.finish()
        return
    for piece in pieces:
        found += rows(d.decode(piece))
    assert sorted(found, key=lambda e: e[3]) == expected
    assert (d.statistics.events, d.statistics.out_of_range) == (len(expected), outside)
    assert d.line == len(lines) + 1
    assert rows(d.finish()[0]) == []


@pytest.mark.parametrize(
    ("number", "unit", "ns"),
    [
        ("1468941032.229000092", "s", 1468941032229000092),  # float64 gives ...000091, 238 ns apart from its neighbour
        ("1468941032.2290000924", "s", 1468941032229000092),
        ("1468941032.2290000925", "s", 1468941032229000093),
        ("1468941032.22900009249999999999", "s", 1468941032229000092),
        ("1.468941032229000092e+09", "s", 1468941032229000092),
        ("14689410322290000925e-10", "s", 1468941032229000093),
        ("13.582595999000001", "s", 13582595999),
        ("0.6367649989999999", "s", 636764999),
        ("0.1", "ns", 0),
        ("1.5", "us", 1500),
        ("0", "s", 0),
        ("0e99", "s", 0),
        ("4611686018427387904", "ns", 2**62),
    ],
)
def test_times_are_exact(number, unit, ns):
    d = TextDecoder(TextLayout(("t", "x", "y", "p"), unit), WIDTH, HEIGHT)
    assert rows(d.decode(f"{number} 3 4 1\n".encode())) == [(3, 4, 1, ns)]


@pytest.mark.parametrize("number", ["4611686018427387905", "99999999999999999999", "1e19", "nan", "inf", "0x10", "1_0"])
def test_impossible_times(number):
    d = TextDecoder(TextLayout(("t", "x", "y", "p"), "ns"), WIDTH, HEIGHT)
    d.decode(f"5 3 4 1\n{number} 3 4 1\n6 3 4 1\n".encode())
    with pytest.raises(RecordingError, match=rf"line 2: t is '{number}', not a time from 0 s to 146 years"):
        d.finish()


def test_a_last_line_without_an_end():
    def finish(text):
        d = TextDecoder(TextLayout(("x", "y", "p", "t"), "us"), WIDTH, HEIGHT)
        d.decode(text)
        events, lost = d.finish()
        return rows(events), lost

    assert finish(b"1,2,1,100\n") == ([], 0)
    assert finish(b"1,2,1,100\n3,4,0,101") == ([(3, 4, 0, 101_000)], 0)
    assert finish(b"1,2,1,100\n3,4,0,10") == ([], 8)  # cut from a later time
    assert finish(b"1,2,1,100\n3,4,") == ([], 4)


def test_steps_back_and_endless_lines():
    d = TextDecoder(TextLayout(("t", "x", "y", "p"), "us"), WIDTH, HEIGHT)
    assert rows(d.decode(b"5 1 1 1\n4 2 2 -1\n"))[0] == (2, 2, 0, 4000)
    assert d.statistics.out_of_order == 1
    with pytest.raises(RecordingError, match="steps back"):
        d.decode(b"1000000 1 1 1\n5 1 1 1\n")
    for _ in range(4):
        d.decode(np.full(1000, ord("1"), np.uint8))
    with pytest.raises(RecordingError, match="line 5 is longer than"):
        d.decode(np.full(1000, ord("1"), np.uint8))


def test_layouts_that_are_none():
    with pytest.raises(RecordingError, match="needed are x, y, p and t"):
        TextLayout(("x", "y", "x", "t"), "s")
    with pytest.raises(RecordingError, match="'min'"):
        TextLayout(("x", "y", "p", "t"), "min")
