"""EVT2, DAT, libcaer and libcaer_cmp on short streams written by hand from their definitions."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_core.codecs import decoder


def rows(events):
    return [tuple(int(v) for v in row) for row in events]


def evt2(kind, low=0, x=0, y=0):
    return kind << 28 | low << 22 | x << 11 | y


def test_evt2():
    d = decoder("evt2", 640, 480)
    first = [evt2(1, 5, 9, 9), 0x8 << 28 | 2, evt2(1, 63, 639, 479), evt2(0, 63, 640, 0), 0xA << 28 | 3 << 8 | 1]
    assert rows(d.decode(np.array(first, "<u4"))) == [(639, 479, 1, (128 + 63) * 1000)]
    assert rows(d.triggers) == [(128_000, 1, 3)]
    # The time of the first packet goes on in the second, and over the wrap of its 34 bits.
    second = [
        evt2(0, 63, 1, 2),
        0x8 << 28 | 2**28 - 2,
        0x8 << 28 | 2**28 - 1,
        evt2(0, 63, 3, 4),
        0x5 << 28,
        0xE << 28,
        0x8 << 28,
        evt2(1, 1, 5, 6),
    ]
    wrap = 2**34
    assert rows(d.decode(np.array(second[:1], "<u4"))) == [(1, 2, 0, 191_000)]
    assert rows(d.decode(np.array(second[1:], "<u4"))) == [(3, 4, 0, (wrap - 1) * 1000), (5, 6, 1, (wrap + 1) * 1000)]
    s = d.statistics
    assert (s.events, s.out_of_range, s.unsynchronised, s.unknown_words, s.triggers_rising) == (4, 1, 1, 1, 1)


def test_evt2_step_back_is_no_wrap():
    d = decoder("evt2", 640, 480)
    events = d.decode(np.array([0x8 << 28 | 9, evt2(0, 0, 1), 0x8 << 28 | 8, evt2(0, 0, 2)], "<u4"))
    assert rows(events) == [(2, 0, 0, 512_000), (1, 0, 0, 576_000)]
    assert d.statistics.out_of_order == 1


def test_dat_goes_on_over_the_wrap_of_its_clock():
    d = decoder("dat", 1280, 720)

    def packet(*events):
        return np.array([[t % 2**32, x | y << 14 | p << 28] for x, y, p, t in events], "<u4").tobytes()

    stream = [(1279, 719, 1, 2**32 - 2), (5, 6, 0, 2**32 + 3), (7, 8, 1, 2**32 + 4), (1, 1, 0, 2**32 + 50_000)]
    found = []
    for events in (stream[:1], [], stream[1:2], [(1280, 0, 1, 2**32 + 3), stream[2]], stream[3:]):
        found += rows(d.decode(packet(*events)))
    assert found == [(x, y, p, t * 1000) for x, y, p, t in stream]
    assert d.statistics.out_of_range == 1


def test_libcaer_rolls_over_inside_a_packet_and_skips_invalid_events():
    base = 1_700_000_000_000_000_000
    words = [
        [1 | 1 << 1 | 3 << 2 | 5 << 17, 2**31 - 1],
        [0 | 1 << 1 | 3 << 2 | 5 << 17, 2**31 - 1],  # not valid
        [1 | 0 << 1 | 259 << 2 | 345 << 17, 2],
        [1 | 0 << 1 | 260 << 2 | 345 << 17, 3],  # outside
    ]
    d = decoder("libcaer", 346, 260)
    events = d.decode(np.array(words, "<u4").tobytes(), base)
    assert rows(events) == [(5, 3, 1, base + (2**31 - 1) * 1000), (345, 259, 0, base + (2**31 + 2) * 1000)]
    assert d.statistics.out_of_range == 1


class PlainLibcaerCmp:
    """Slow and obvious, in stream order."""

    def __init__(self):
        self.x = self.base = self.polarity = None
        self.events = []
        self.out_of_range = self.unsynchronised = self.unknown = 0

    def packet(self, words, time_base):  # noqa: C901 - one branch per code
        high = low = 0
        for word in words:
            code, value = word >> 12, word & 0xFFF
            t = time_base + (high << 12 | low) * 1000
            if code == 0:
                high = value
            elif code == 1:
                low = value
            elif code == 2:
                self.x = value & 0x7FF
            elif code == 3:
                self.event(value & 0x7FF, value >> 11, t)
            elif code == 4:
                self.base, self.polarity = value & 0x7FF, value >> 11
            elif code == 5:
                for bit in range(8):
                    if value >> bit & 1:
                        self.event(None if self.base is None else self.base + bit, self.polarity, t)
                if self.base is not None:
                    self.base += 8
            else:
                self.unknown += 1

    def event(self, y, p, t):
        if self.x is None or y is None:
            self.unsynchronised += 1
        elif self.x >= 346 or y >= 260:
            self.out_of_range += 1
        else:
            self.events.append((self.x, y, p, t))


value = st.integers(0, 0xFFF)
cmp_word = st.one_of(
    st.builds(lambda v: 0x2000 | v, value | st.integers(0, 350)),
    st.builds(lambda v: 0x3000 | v, value | st.integers(0, 260)),
    st.builds(lambda v: 0x4000 | v, st.integers(0, 270)),
    st.builds(lambda v: 0x5000 | v, value),
    st.builds(lambda v: 0x1000 | v, value),
    st.builds(lambda v: v, st.integers(0, 9)),
    st.builds(lambda c, v: c << 12 | v, st.integers(6, 15), value),
)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.lists(cmp_word, max_size=40), max_size=4))
def test_libcaer_cmp_equals_the_plain_decoder(packets):
    plain, d, events = PlainLibcaerCmp(), decoder("libcaer_cmp", 346, 260), []
    for i, words in enumerate(packets):
        base = 10**18 + i * 10**9
        plain.packet(words, base)
        events += rows(d.decode(np.array(words, "<u2"), base))
    assert events == sorted(plain.events, key=lambda e: e[3])
    s = d.statistics
    assert (s.out_of_range, s.unsynchronised, s.unknown_words) == (
        plain.out_of_range,
        plain.unsynchronised,
        plain.unknown,
    )
