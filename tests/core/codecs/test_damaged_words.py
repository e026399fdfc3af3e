"""One damaged word anywhere in a stream costs at most the events of its reach, and bends the time of no others.

The reach of a word, in events, by encoding: an event word is its own event (EVT2.1 and the vectors of EVT3 and
libcaer_cmp: those of the word); a word of time, row or column reaches to the next of its kind; a text line reaches over
itself and, where its end is damaged, the next one.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from esfo_core.codecs import decoder, encoder
from esfo_core.codecs.text import TextDecoder
from esfo_core.codecs.text_layout import TextLayout
from esfo_core.codecs.time_check import TimeCheck
from esfo_core.errors import RecordingError
from esfo_core.events import make_events

WIDTH, HEIGHT, COUNT = 320, 240, 600
STEP_US = 400  # from one event to the next; the stream is 0.24 s long
START_US = 2**24 - 100_000  # the clock of EVT3 wraps on the way
PACKET = 64  # words


def events_of_stream():
    """Every event is in another row than the one before, so that a word for the row reaches over one event."""
    k = np.arange(COUNT)
    return make_events(k * 7 % WIDTH, k * 11 % HEIGHT, k % 2, (START_US + k * STEP_US) * 1000)


def evt2_words(events, high_every):
    words, latest = [], None
    for i, (x, y, p, t) in enumerate(events.tolist()):
        us = t // 1000
        if latest != us >> 6 or i % high_every == 0:
            words.append(0x8 << 28 | us >> 6)
            latest = us >> 6
        words.append(p << 28 | (us & 63) << 22 | x << 11 | y)
    return np.array(words, "<u4")


def evt21_words(events):
    upper = evt2_words(events, 1)
    words = np.zeros((len(upper), 2), "<u4")
    words[:, 1] = upper
    words[upper >> 28 <= 1, 0] = 1
    return words.view("<u8").ravel()


def pair_words(events, encoding):
    us = (events["t"] // 1000).astype("<u4")
    x, y, p = (events[name].astype("<u4") for name in "xyp")
    data = x | y << 14 | p << 28 if encoding == "dat" else 1 | p << 1 | y << 2 | x << 17
    return np.stack([us, data] if encoding == "dat" else [data, us], axis=1).astype("<u4").view("<u8").ravel()


def cmp_words(events):
    words = []
    for x, y, p, t in events.tolist():
        us = t // 1000 - START_US
        words += [us >> 12, 0x1000 | us & 0xFFF, 0x2000 | x, 0x3000 | p << 11 | y]
    return np.array(words, "<u2")


EVENTS = events_of_stream()
STREAMS = {
    "evt2": (evt2_words(EVENTS, 1), 1),
    "evt21": (evt21_words(EVENTS), 32),
    "evt3": (np.frombuffer(encoder("evt3")(EVENTS)[1], "<u2"), 12),
    "dat": (pair_words(EVENTS, "dat"), 1),
    "libcaer": (pair_words(EVENTS, "libcaer"), 1),
    "libcaer_cmp": (cmp_words(EVENTS), 8),
    "mono": (np.frombuffer(encoder("mono")(EVENTS)[1], "<u8"), 1),
}
"""Words by encoding, and how many events one of them can hold or, damaged, seem to hold."""

HIGH_REACH = {"evt3": 4096 // STEP_US + 1}
"""Events up to the next TIME_HIGH; elsewhere one comes with every event."""


def read(encoding, words):
    """Segment with the most events, of the packets through decoder and check."""
    events_of = decoder(encoding, WIDTH, HEIGHT)
    base = START_US * 1000 if encoding in ("mono", "libcaer_cmp") else 0
    packets = [words[i : i + PACKET] for i in range(0, len(words), PACKET)]
    return largest(part for w in packets for part in events_of.decode_parts(w.tobytes(), base))


def largest(parts):
    check, segments = TimeCheck(), [[]]
    checked = [pair for part in parts for pair in check.push(part)]
    for part, anew in [*checked, *check.flush()]:
        segments += [[]] if anew else []
        segments[-1].append(part)
    return max((np.concatenate(s) for s in segments if s), key=len)


@pytest.mark.parametrize("encoding", STREAMS)
def test_the_whole_stream_is_read(encoding):
    assert (read(encoding, STREAMS[encoding][0]) == EVENTS).all()


@pytest.mark.parametrize("encoding", STREAMS)
@settings(max_examples=400, deadline=None)
@given(
    place=st.floats(0, 1, exclude_max=True), flip=st.integers(0, 2**64 - 1) | st.integers(0, 63).map(lambda b: 1 << b)
)
@example(place=0.0, flip=1 << 31)
@example(place=0.5, flip=1 << 31)
@example(place=0.5, flip=1 << 30)
@example(place=0.999999, flip=1 << 62)
def test_one_damaged_word(encoding, place, flip):
    words, vector = STREAMS[encoding]
    words = words.copy()
    words[int(place * len(words))] ^= np.array(flip & (2 ** (8 * words.itemsize) - 1), words.dtype)
    try:
        got = read(encoding, words)
    except RecordingError as error:
        pytest.fail(str(error))
    whole = {event.tolist() for event in EVENTS}
    kept = {event.tolist() for event in got} & whole
    reach = HIGH_REACH.get(encoding, 2)
    assert len(whole) - len(kept) <= reach
    assert len(got) - len(kept) <= reach + vector  # what the damaged word made of the events of its reach, and its own


def as_text(columns):
    rows = zip(*(EVENTS[name].tolist() for name in columns), strict=True)
    return "".join(",".join(str(v // 1000 if v > 10**6 else v) for v in row) + "\n" for row in rows).encode()


@pytest.mark.parametrize("columns", ["xypt", "txyp"])
@settings(max_examples=400, deadline=None)
@given(place=st.floats(0, 1, exclude_max=True), byte=st.integers(0, 255) | st.sampled_from(list(b"0123456789,\n -.e#")))
def test_one_damaged_byte_of_a_text(columns, place, byte):
    text = bytearray(as_text(columns))
    text[int(place * len(text))] = byte
    d = TextDecoder(TextLayout(tuple(columns), "us"), WIDTH, HEIGHT)
    parts = [part for i in range(0, len(text), 500) for part in d.decode_parts(bytes(text[i : i + 500]))]
    got = largest([*parts, d.finish()[0]])
    whole = {event.tolist() for event in EVENTS}
    kept = {event.tolist() for event in got} & whole
    assert len(whole) - len(kept) <= 2
    assert len(got) - len(kept) <= 1
