"""EVT3 against a plain decoder that follows the words one by one."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_core.codecs import decoder

WIDTH, HEIGHT = 1280, 720
COUNTERS = ("events", "triggers_rising", "triggers_falling", "out_of_range", "unsynchronised", "unknown_words")


class PlainEvt3:
    """Slow and obvious: events (x, y, p, t) and triggers (t, edge, id) in stream order."""

    def __init__(self):
        self.high = self.low = self.y = self.base = self.polarity = None
        self.events, self.triggers = [], []
        self.out_of_range = self.unsynchronised = self.unknown_words = 0

    def word(self, word):  # noqa: C901, PLR0912 - one branch per code
        code, value = word >> 12, word & 0xFFF
        if code == 0x0:
            self.y = value & 0x7FF
        elif code == 0x2:
            self.event(value & 0x7FF, value >> 11)
        elif code == 0x3:
            self.base, self.polarity = value & 0x7FF, value >> 11
        elif code in (0x4, 0x5):
            for bit in range(12 if code == 0x4 else 8):
                if value >> bit & 1:
                    self.event(None if self.base is None else self.base + bit, self.polarity)
            if self.base is not None:
                self.base += 12 if code == 0x4 else 8
        elif code == 0x6:
            if self.high is not None:
                self.low = value
        elif code == 0x8:
            if self.high is None:
                self.high = value
            else:
                continuations = range(self.high - 10, self.high - 10 + 4096)
                self.high = next(h for h in continuations if h % 4096 == value)
        elif code == 0xA:
            if self.low is None:
                self.unsynchronised += 1
            else:
                self.triggers.append((self.time(), value & 1, value >> 8))
        elif code not in (0x7, 0xE, 0xF):
            self.unknown_words += 1

    def event(self, x, p):
        if None in (self.low, self.y, x):
            self.unsynchronised += 1
        elif x >= WIDTH or self.y >= HEIGHT:
            self.out_of_range += 1
        else:
            self.events.append((x, self.y, p, self.time()))

    def time(self):
        return (self.high * 4096 + self.low) * 1000


def as_rows(events):
    return [tuple(int(v) for v in row) for row in events]


def decode_in_pieces(data, cuts):
    """Decode bytes cut at the given positions; events, triggers and decoder."""
    d = decoder("evt3", WIDTH, HEIGHT)
    events, triggers = [], []
    for start, end in pairwise([0, *cuts, len(data)]):
        events += as_rows(d.decode(data[start:end], 0))
        triggers += as_rows(d.triggers)
    return events, triggers, d


def time_words(t):
    return [0x8000 | (t >> 12) & 0xFFF, 0x6000 | t & 0xFFF]


@st.composite
def streams(draw):
    """Words as a sensor sends them, around a wrap of the clock, with noise in TIME_HIGH, junk and a ragged start."""
    value = st.integers(0, 0xFFF)
    word = st.one_of(
        st.builds(lambda v: [0x0000 | v], st.integers(0, 0x7FF) | st.integers(0, HEIGHT - 1)),
        st.builds(lambda v: [0x2000 | v], value),
        st.builds(lambda v: [0x3000 | v], value | st.integers(WIDTH - 20, WIDTH + 4)),
        st.builds(lambda v: [0x4000 | v], value),
        st.builds(lambda v: [0x5000 | v], value),
        st.builds(lambda v: [0xA000 | v], value),
        st.builds(lambda c, v: [c << 12 | v], st.sampled_from([0x1, 0x7, 0x9, 0xB, 0xC, 0xD, 0xE, 0xF]), value),
    )
    advance = st.tuples(st.integers(0, 9000), st.integers(0, 10))  # us on, steps of TIME_HIGH behind
    t = draw(st.integers((1 << 24) - 40_000, (1 << 24) + 10_000))
    words = []
    for item in draw(st.lists(word | advance, max_size=80)):
        if isinstance(item, tuple):
            t += item[0]
            words += time_words(t - item[1] * 4096)
        else:
            words += item
    return words


@settings(max_examples=200, deadline=None)
@given(streams(), st.data())
def test_any_stream_cut_anywhere_equals_the_plain_decoder(words, data):
    cuts = sorted(data.draw(st.lists(st.integers(0, len(words)), max_size=6)))
    plain = PlainEvt3()
    for word in words:
        plain.word(word)
    events, triggers, d = decode_in_pieces(np.array(words, "<u2").tobytes(), [2 * c for c in cuts])
    assert sorted(events, key=lambda e: e[3]) == sorted(plain.events, key=lambda e: e[3])
    assert triggers == plain.triggers
    rising = sum(edge for _, edge, _ in plain.triggers)
    assert [getattr(d.statistics, name) for name in COUNTERS] == [
        len(plain.events),
        rising,
        len(plain.triggers) - rising,
        plain.out_of_range,
        plain.unsynchronised,
        plain.unknown_words,
    ]


def decode(words):
    d = decoder("evt3", WIDTH, HEIGHT)
    return d.decode(np.array(words, "<u2")), d


def test_time_goes_on_over_the_wrap_of_the_clock():
    times = [5, (1 << 24) - 1, (1 << 24) + 7, (1 << 25) + 3]
    words, t = [0x0005], 0
    for wanted in times:
        while wanted - t > 1 << 22:  # the sensor repeats its time many times per wrap
            t += 1 << 22
            words += time_words(t)
        words += [*time_words(wanted), 0x2003]
    d = decoder("evt3", WIDTH, HEIGHT)
    found = [d.decode(np.array([word], "<u2"))["t"] for word in words]
    assert (np.concatenate(found) // 1000).tolist() == times


def test_a_high_time_up_to_ten_steps_old_is_noise_and_beyond_it_is_a_wrap():
    for steps, expected in ((10, 100 - 10), (11, 100 - 11 + 4096)):
        known = [*time_words(99 * 4096), *time_words(100 * 4096)]
        events, _ = decode([0x0001, *known, *time_words((100 - steps) * 4096), 0x2001])
        assert events["t"][0] == expected * 4096 * 1000


def test_an_old_high_time_after_the_wrap_is_no_second_wrap():
    t = 1 << 24
    words = [0x0001, *time_words(t - 1), 0x2001, *time_words(t + 1), 0x2002, *time_words(t - 4096), 0x2003]
    words += [*time_words(t + 2), 0x2004]
    events, d = decode(words)
    assert events["x"].tolist() == [3, 1, 2, 4]
    assert (events["t"] // 1000).tolist() == [t - 4096, t - 1, t + 1, t + 2]
    assert d.statistics.out_of_order == 1


def test_nothing_is_emitted_before_high_and_low_time_and_row_are_known():
    words = [0x0007, 0x6001, 0x2001, 0x8001, 0x2002, 0xA001, 0x6002, 0x4FFF, 0x2004, 0xA001]
    events, d = decode(words)
    assert as_rows(events) == [(4, 7, 0, (4096 + 2) * 1000)]
    assert d.statistics.unsynchronised == 3 + 12
    assert d.statistics.triggers_rising == 1
    assert len(decode([*time_words(5), 0x2001])[0]) == 0


def test_after_a_lost_packet_nothing_stale_is_emitted():
    d = decoder("evt3", WIDTH, HEIGHT)
    t = 1 << 24
    d.decode(np.array([0x0005, 0x3010, *time_words(t - 9), *time_words(t + 1), 0x2001], "<u2"))
    d.resynchronise()
    stale = [0x2002, 0x4001, 0x6009, 0x0006, 0x2003]  # no row, no column, no high time
    again = [*time_words(t - 1), 0x2004, *time_words(t + 5), 0x2005]  # an old high time is no wrap
    events = d.decode(np.array(stale + again, "<u2"))
    assert as_rows(events) == [(4, 6, 0, (t - 1) * 1000), (5, 6, 0, (t + 5) * 1000)]
    assert d.statistics.unsynchronised == 3


def test_an_odd_byte_is_counted():
    d = decoder("evt3", WIDTH, HEIGHT)
    d.decode(b"\x01\x80\x00", 0)
    assert d.statistics.trailing_bytes == 1
