"""Events to EVT3 and back: equal to the last event, wherever the stream is cut or joined."""

from __future__ import annotations

from itertools import accumulate

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_codec_evt3 import PlainEvt3

from esfo_core.codecs import decoder, encoder
from esfo_core.errors import RecordingError
from esfo_core.events import make_events

WIDTH, HEIGHT = 1280, 720
WRAP_NS = 2**24 * 1000
STEP = 4096  # us


def events_of(rows):
    x, y, p, t = (np.array(column) for column in zip(*rows, strict=True))
    return make_events(x, y, p, t * 1000)


@st.composite
def packets(draw):
    """Packets of one stream: runs along rows, as vectors hold them, single events, and steps of any length in time."""
    step = st.sampled_from([0, 0, 1, 4095, 4096, STEP * 4085, STEP * 4086, STEP * 4096]) | st.integers(0, 10**8)
    run = st.tuples(step, st.integers(0, 2047), st.integers(0, 2), st.integers(0, 1), st.lists(st.integers(-1, 13)))
    t, parts = draw(st.integers(0, 2 * 10**15)), []
    for runs in draw(st.lists(st.lists(run, min_size=1, max_size=6), min_size=1, max_size=4)):
        rows = []
        for dt, x, y, p, steps in runs:
            t += dt
            rows += [((x + dx) % 2048, y, p, t) for dx in accumulate([0, *steps])]
        parts.append(events_of(rows))
    return parts


@settings(max_examples=300, deadline=None)
@given(packets(), st.data())
def test_events_come_back_as_they_went_from_any_packet_on(parts, data):
    encode = encoder("evt3")
    encoded = [encode(part) for part in parts]
    first = data.draw(st.integers(0, len(parts) - 1))
    d = decoder("evt3", 2048, 2048)
    for part, (time_base, packet) in list(zip(parts, encoded, strict=True))[first:]:
        assert (d.decode(packet, time_base) == part).all()
        assert time_base <= part["t"][0]
    s = d.statistics
    assert s.out_of_order == s.unsynchronised == s.unknown_words == s.out_of_range == s.trailing_bytes == 0


@settings(max_examples=100, deadline=None)
@given(packets())
def test_a_plain_decoder_counts_every_wrap(parts):
    encode, plain = encoder("evt3"), PlainEvt3()
    for part in parts:
        for word in np.frombuffer(encode(part)[1], "<u2").tolist():
            plain.word(word)
    together = np.concatenate(parts)
    inside = together[together["x"] < WIDTH]
    shift = together["t"][0] // WRAP_NS * WRAP_NS  # nothing in the words tells the wraps before the first packet
    found = [(x, y, p, t + shift) for x, y, p, t in plain.events]
    assert found == inside.tolist()
    assert plain.out_of_range == len(together) - len(inside)


def test_words():
    events = events_of([(5, 7, 1, 4097), (6, 7, 1, 4097), (9, 7, 1, 4097), (17, 7, 1, 4097), (8, 3, 0, 8192)])
    time_base, data = encoder("evt3")(events)
    assert time_base == 4_097_000
    assert np.frombuffer(data, "<u2").tolist() == [
        *(0x8001, 0x6001, 0x0007, 0x3805, 0x4000 | 0b10011, 0x2811),  # a vector of 12 columns and one event beyond it
        *(0x8002, 0x6000, 0x0003, 0x2008),
    ]


def test_vectors_of_one_polarity_that_follow_one_another_need_one_address():
    events = events_of([(x, 0, int(x < 24), 9) for x in range(36)])
    _, data = encoder("evt3")(events)
    assert np.frombuffer(data, "<u2").tolist() == [
        *(0x8000, 0x6009, 0x0000),
        *(0x3800, 0x4FFF, 0x4FFF),
        *(0x3000 | 24, 0x4FFF),
    ]


def test_a_time_base_that_the_words_do_not_state_is_not_used():
    words = np.array([0x8001, 0x6001, 0x0002, 0x2003], "<u2").tobytes()
    stated = WRAP_NS * 100 + 4097 * 1000
    for time_base, expected in ((stated, stated), (stated + 1, 4_097_000), (stated + 1000, 4_097_000), (0, 4_097_000)):
        assert decoder("evt3", WIDTH, HEIGHT).decode(words, time_base)["t"].tolist() == [expected]
    d = decoder("evt3", WIDTH, HEIGHT)
    assert d.decode(words, 0)["t"].tolist() == d.decode(words, stated)["t"].tolist()  # only the first packet's counts


def test_times_that_are_no_whole_microseconds_are_refused_or_rounded_down():
    events = make_events(*(np.array(c) for c in ([1, 2], [3, 4], [0, 1], [10_000, 20_999])))
    with pytest.raises(RecordingError, match="time 20999 ns is no whole microsecond"):
        encoder("evt3")(events)
    time_base, data = encoder("evt3", round_times=True)(events)
    assert decoder("evt3", 9, 9).decode(data, time_base)["t"].tolist() == [10_000, 20_000]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([(2048, 0, 0, 0)], r"pixel \(2048, 0\) is above 2047"),
        ([(0, 2048, 0, 0)], r"pixel \(0, 2048\) is above 2047"),
        ([(0, 0, 0, 2), (0, 0, 0, 1)], "not in time order"),
        ([(0, 0, 0, -1)], "negative"),
    ],
)
def test_impossible_events_are_refused(rows, message):
    with pytest.raises(RecordingError, match=message):
        encoder("evt3")(events_of(rows))


def test_steps_back_between_packets_are_refused():
    encode = encoder("evt3")
    encode(events_of([(0, 0, 0, 5)]))
    with pytest.raises(RecordingError, match="not in time order, or negative, after 5 us"):
        encode(events_of([(0, 0, 0, 4)]))


def test_unknown_encodings_are_named():
    with pytest.raises(RecordingError, match="'libcaer' cannot be written; choose from mono, evt3"):
        encoder("libcaer")
