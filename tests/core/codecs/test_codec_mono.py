"""The mono encoding: its bit layout, and events through it and back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_core.codecs import decoder, encode_mono
from esfo_core.errors import RecordingError
from esfo_core.events import empty_events, make_events


def events_of(rows):
    x, y, p, t = (np.array(c) for c in zip(*sorted(rows, key=lambda r: r[3]), strict=True))
    return make_events(x, y, p, t)


def test_bit_layout():
    events = make_events(np.array([0x1234]), np.array([0x0567]), np.array([1]), np.array([1_000_000_000 + 0x89ABCDEF]))
    assert encode_mono(events, 1_000_000_000).hex() == "efcdab89" + "3412" + "6785"


@settings(max_examples=50, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, 345), st.integers(0, 259), st.integers(0, 1), st.integers(0, 50_000_000)), min_size=1
    ),
    st.integers(0, 2**60),
)
def test_events_come_back_as_they_went(rows, base):
    events = events_of([(x, y, p, base + t) for x, y, p, t in rows])
    assert (decoder("mono", 346, 260).decode(encode_mono(events, base), base) == events).all()


def test_no_events_are_no_bytes():
    assert encode_mono(empty_events(), 0) == b""
    assert len(decoder("mono", 10, 10).decode(b"", 0)) == 0


@pytest.mark.parametrize("t", [-1, 2**32])
def test_a_time_that_does_not_fit_is_refused(t):
    with pytest.raises(RecordingError, match="do not fit one packet"):
        encode_mono(events_of([(0, 0, 0, 500 + t)]), 500)
    longest = events_of([(0, 0, 0, 500 + 2**32 - 1)])
    assert (decoder("mono", 1, 1).decode(encode_mono(longest, 500), 500) == longest).all()


def test_a_row_that_does_not_fit_is_refused():
    with pytest.raises(RecordingError, match="row 32768"):
        encode_mono(events_of([(0, 2**15, 0, 0)]), 0)


def test_events_outside_the_sensor_are_counted_and_dropped():
    d = decoder("mono", 4, 3)
    events = d.decode(encode_mono(events_of([(3, 2, 0, 0), (4, 0, 0, 1), (0, 3, 1, 2), (0, 0, 1, 3)]), 0), 0)
    assert events["t"].tolist() == [0, 3]
    assert (d.statistics.events, d.statistics.out_of_range) == (2, 2)


def test_jitter_is_sorted_and_counted():
    d = decoder("mono", 10, 10)
    events = d.decode(np.array([1000 | 1 << 32, 500 | 2 << 32, 700 | 3 << 32, 1000 | 4 << 32], "<u8"), 0)
    assert events["t"].tolist() == [500, 700, 1000, 1000]
    assert events["x"].tolist() == [2, 3, 1, 4]
    assert d.statistics.out_of_order == 2


def test_a_large_step_back_is_an_error():
    d = decoder("mono", 10, 10)
    assert len(d.decode(np.array([50_000_000, 0], "<u8"), 0)) == 2
    with pytest.raises(RecordingError, match=r"back by 0\.050000 s inside a packet"):
        d.decode(np.array([50_000_001, 0], "<u8"), 0)


@pytest.mark.parametrize("base", [-1, 2**62, 2**64 - 1])
def test_a_time_base_that_does_not_fit_is_refused(base):
    with pytest.raises(RecordingError, match=f"time base {base} ns"):
        decoder("mono", 1, 1).decode(bytes(8), base)


def test_unknown_encodings_and_sizes_are_named():
    with pytest.raises(RecordingError, match=r"'evt9'; known: .*evt3.*mono"):
        decoder("evt9", 640, 480)
    with pytest.raises(RecordingError, match="0x480"):
        decoder("evt3", 0, 480)
