"""EVT2.1 against a plain decoder, cut anywhere, in both orders of its halves."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_core.codecs import decoder

WIDTH, HEIGHT = 1280, 720
WRAP = 2**28
COUNTERS = ("triggers_rising", "triggers_falling", "out_of_range", "unsynchronised", "unknown_words")


class PlainEvt21:
    """Slow and obvious: events and triggers in stream order."""

    def __init__(self):
        self.high = None
        self.events, self.triggers, self.counts = [], [], dict.fromkeys(COUNTERS, 0)

    def word(self, word):
        kind, low, x, y = word >> 60, word >> 54 & 63, word >> 43 & 0x7FF, word >> 32 & 0x7FF
        if kind == 8:
            value = word >> 32 & (WRAP - 1)
            continuations = [value] if self.high is None else [value + k * WRAP for k in range(3)]
            self.high = min(continuations, key=lambda high: abs(high - (self.high or 0)))
        elif kind in (0, 1):
            for bit in (b for b in range(32) if word >> b & 1):
                self.event(x + bit, y, kind, low)
        elif kind == 10 and self.high is None:
            self.counts["unsynchronised"] += 1
        elif kind == 10:
            edge = word >> 32 & 1
            self.counts["triggers_rising" if edge else "triggers_falling"] += 1
            self.triggers.append(((self.high * 64 + low) * 1000, edge, word >> 40 & 31))
        elif kind not in (14, 15):
            self.counts["unknown_words"] += 1

    def event(self, x, y, p, low):
        if self.high is None:
            self.counts["unsynchronised"] += 1
        elif x >= WIDTH or y >= HEIGHT:
            self.counts["out_of_range"] += 1
        else:
            self.events.append((x, y, p, (self.high * 64 + low) * 1000))


def pack(kind, low, x, y, valid):
    return kind << 60 | low << 54 | x << 43 | y << 32 | valid


event_word = st.one_of(
    st.builds(pack, st.sampled_from([0, 1, 1, 10, 14, 15, 5]), *(st.integers(0, 2**n - 1) for n in (6, 11, 11, 32))),
    st.builds(
        pack, st.just(1), st.integers(0, 63), st.integers(1240, 1290), st.integers(710, 725), st.integers(1, 2**32 - 1)
    ),
)
any_word = event_word | st.builds(lambda high: 8 << 60 | high << 32, st.sampled_from([3, 4, 5, 6, WRAP - 2, WRAP - 1]))


@pytest.mark.parametrize("encoding", ["evt21", "evt21_legacy"])
@settings(max_examples=150, deadline=None)
@given(
    before=st.lists(event_word, max_size=5),
    after=st.lists(any_word, max_size=25),
    cuts=st.lists(st.integers(0, 30), max_size=4),
)
def test_decoder_equals_the_plain_one(encoding, before, after, cuts):
    words = [*before, 8 << 60 | WRAP - 2 << 32, *after]  # from there on steps are small, over the wrap and back
    plain, d, events, triggers = PlainEvt21(), decoder(encoding, WIDTH, HEIGHT), [], []
    for start, stop in pairwise([0, *sorted(cuts), len(words)]):
        first = len(plain.events)
        for word in words[start:stop]:
            plain.word(word)
        times = np.array([e[3] for e in plain.events[first:]], np.int64)
        if len(times) and (np.maximum.accumulate(times) - times).max() > 50_000_000:
            return  # a jump inside a packet is refused
        halves = np.array(words[start:stop], "<u8").view("<u4").reshape(-1, 2)
        events += d.decode((halves if encoding == "evt21" else halves[:, ::-1]).tobytes()).tolist()
        plain.events[first:] = sorted(plain.events[first:], key=lambda e: e[3])
        triggers += d.triggers.tolist()
    assert events == plain.events
    assert triggers == plain.triggers
    assert {name: getattr(d.statistics, name) for name in COUNTERS} == plain.counts
