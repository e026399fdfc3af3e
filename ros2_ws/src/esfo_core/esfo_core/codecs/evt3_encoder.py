"""Events to `evt3` packets: what `codecs.evt3` reads, lossless for times of whole microseconds."""

from __future__ import annotations

import numpy as np
from numba import njit

from esfo_core.codecs.evt3 import (
    ADDR_X,
    ADDR_Y,
    HIGH_PERIOD,
    TIME_HIGH,
    TIME_LOW,
    VECT_12,
    VECT_BASE_X,
)
from esfo_core.errors import RecordingError
from esfo_core.events import EventArray

MICROSECOND = 1000
MAX_PIXEL = 2**11 - 1
"""Highest column and row that a word holds."""

LONGEST_STEP = HIGH_PERIOD // 4
"""Largest step of TIME_HIGH, so that a decoder sees it go on forward and takes no word of it for a damaged one."""

SHORTEST_VECTOR = 3  # events; a vector takes two words, a single event one


class Evt3Encoder:
    """Turns the packets of one stream, in order, into `evt3` data.

    Each packet begins with time and row, so that a reader can join at any of them; long stretches without events are
    bridged with times, so that a reader counts every wrap of the clock. Runs of events of one time, row and polarity
    with growing columns become vectors.

    round_times: round times down to microseconds instead of refusing others.
    """

    def __init__(self, round_times: bool = False) -> None:
        self._round_times = round_times
        self._latest: int | None = None  # us

    def encode(self, events: EventArray) -> tuple[int, bytes]:
        """Encode the events (N,), N > 0, of the next packet; return its time base in ns and its data.

        The time base is the time that the first two words of the packet state without the wraps of the clock; in the
        first packet it tells the decoder how often the clock has wrapped.
        Raises RecordingError for times that step back, are negative or no whole microseconds, and for columns or rows
        above 2047.
        """
        t, rest = np.divmod(np.ascontiguousarray(events["t"]), MICROSECOND)
        if rest.any() and not self._round_times:
            raise RecordingError(
                f"time {events['t'][np.argmax(rest > 0)]} ns is no whole microsecond, the finest that `evt3` holds"
            )
        latest = 0 if self._latest is None else self._latest
        if t[0] < latest or (t[1:] < t[:-1]).any():
            raise RecordingError(f"events are not in time order, or negative, after {latest} us")
        if max(events["x"].max(), events["y"].max()) > MAX_PIXEL:
            raise RecordingError(
                f"pixel ({events['x'].max()}, {events['y'].max()}) is above {MAX_PIXEL}, the largest that `evt3` holds"
            )
        start = int(t[0])
        if self._latest is not None and (start >> 12) - (latest >> 12) > LONGEST_STEP:
            start = latest
        words = np.empty(4 + 4 * len(t) + (int(t[-1]) - start >> 12) // LONGEST_STEP, np.uint16)
        count = _encode(t, events, start, words)
        self._latest = int(t[-1])
        return start * MICROSECOND, words[:count].astype("<u2", copy=False).tobytes()


@njit(cache=True, nogil=True)
def _encode(t, events, start, words):  # type: ignore[no-untyped-def]
    """Encode events (N,) at the times `t` (N,) in us, from the time `start` on, into `words`; return their number."""
    time, row = start, -1
    column, polarity = np.int64(-1), np.int64(-1)  # of the next vector, should it go on where the last one ended
    words[0], words[1] = TIME_HIGH << 12 | time >> 12 & 0xFFF, TIME_LOW << 12 | time & 0xFFF
    n, i = 2, 0
    while i < len(t):
        if t[i] != time:
            n = _encode_time(time, t[i], words, n)
            time = t[i]
        if events[i].y != row:
            row = events[i].y
            words[n] = ADDR_Y << 12 | row
            n += 1
        x, p = np.int64(events[i].x), np.int64(events[i].p != 0)
        end, bits = _vector(t, events, i)
        if end - i < SHORTEST_VECTOR:
            words[n] = ADDR_X << 12 | p << 11 | x
            n, i = n + 1, i + 1
            continue
        if x != column or p != polarity:
            words[n] = VECT_BASE_X << 12 | p << 11 | x
            n += 1
        words[n] = VECT_12 << 12 | bits
        n, i = n + 1, end
        column, polarity = x + 12, p
    return n


@njit(cache=True, nogil=True)
def _encode_time(time, t, words, n):  # type: ignore[no-untyped-def]
    """Write the words that lead from the time `time` to `t`, both in us, at `n`; return the new number of words."""
    high, end = time >> 12, t >> 12
    while high != end:
        high += min(end - high, LONGEST_STEP)
        words[n] = TIME_HIGH << 12 | high & 0xFFF
        n += 1
    words[n] = TIME_LOW << 12 | t & 0xFFF
    return n + 1


@njit(cache=True, nogil=True)
def _vector(t, events, i):  # type: ignore[no-untyped-def]
    """Return the end of the longest run from event `i` on that one vector holds, and its bits."""
    first = events[i]
    bits, before, j = 1, first.x, i + 1
    while j < len(t) and t[j] == t[i] and events[j].y == first.y and (events[j].p != 0) == (first.p != 0):
        x = events[j].x
        if x <= before or x >= first.x + 12:
            break
        bits |= 1 << (x - first.x)
        before, j = x, j + 1
    return j, bits
