"""Random bytes into every decoder: events in order and on the sensor, or a RecordingError, and every byte counted."""

from __future__ import annotations

import dataclasses

import numpy as np

from esfo_core.codecs import encoder
from esfo_core.codecs.event_array import cdr_size
from esfo_core.codecs.factory import decoder
from esfo_core.errors import RecordingError
from esfo_core.events import make_events

WIDTH, HEIGHT = 346, 260
HEAD = 9
MOST_EVENTS_OF_WORD = {"evt3": 12, "libcaer_cmp": 8, "evt21": 32, "evt21_legacy": 32}


def seeds(encoding: str) -> list[bytes]:
    """Inputs to begin with: the time base (8 bytes), a byte for the lengths of the packets, and data."""
    head = (1_700_000_000_000_000_000).to_bytes(8, "little") + b"\x05"
    rng = np.random.default_rng(0)
    count = 40
    t = np.sort(rng.integers(0, 1000, count)) * 1000
    x, y, p = rng.integers(0, WIDTH, count), rng.integers(0, HEIGHT, count), rng.integers(0, 2, count)
    rows = make_events(np.arange(count) + 3, np.full(count, 9), np.zeros(count), np.full(count, 5000))
    scattered = make_events(x, y, p, t)
    vectors = [0, 0x8 << 28 | 3, 0xF00F, 0x1 << 28 | 5 << 22 | 9 << 11 | 7, 1 << 31, 330 << 11, 0, 0xA << 28 | 1]
    words = {
        "evt3": [encoder("evt3")(rows)[1], encoder("evt3")(scattered)[1] + b"\x01\xa0\x00\xb0"],
        "mono": [encoder("mono")(scattered)[1]],
        "evt2": [
            _words("<u4", [0x8 << 28 | 3, 0x1 << 28 | 5 << 22 | 9 << 11 | 7, 0xA << 28 | 1, 0x8 << 28, 0x5 << 28])
        ],
        "evt21": [_words("<u4", vectors)],
        "evt21_legacy": [np.array(vectors, "<u4").reshape(-1, 2)[:, ::-1].tobytes()],
        "dat": [_words("<u4", [2**32 - 2, 5 | 6 << 14, 3, 345 | 259 << 14 | 1 << 28])],
        "libcaer": [_words("<u4", [1 | 3 << 2 | 5 << 17, 2**31 - 1, 3 | 259 << 2 | 345 << 17, 4])],
        "libcaer_cmp": [_words("<u2", [0x0001, 0x1002, 0x2005, 0x3807, 0x4803, 0x50FF, 0x5001, 0x6000])],
        "cdr_event_array": [bytes([1, 0] * 30)[: cdr_size(3)], bytes(cdr_size(4))],
        "cdr_event_array_be": [bytes([0, 1] * 30)[: cdr_size(3)], bytes(cdr_size(4))],
        "ros1_event_array": [bytes([1, 0, 2, 0, 1, 0, 2, 0, 1, 0, 2, 0, 1] * 3)],
    }
    return [head + data for data in [*words.get(encoding, []), b"", b"\xff" * 64, bytes(64)]]


def check(encoding: str, data: bytes) -> None:
    """Decode `data` in up to four packets, as `seeds` lays them out; raise for anything but events or RecordingError.

    Every call must return events that are sorted and on the sensor, no more than the words can hold, and counters that
    grow; what comes out must not depend on whether the packets lie in the same memory.
    """
    first, second = decoder(encoding, WIDTH, HEIGHT), decoder(encoding, WIDTH, HEIGHT)
    time_base, body = int.from_bytes(data[:8], "little"), data[HEAD:]
    size = first.word.itemsize * max(1, data[8] if len(data) > 8 else 1)
    cuts = [body[: 2 * size], body[2 * size : 5 * size], body[5 * size : 9 * size], body[9 * size :]]
    before = dataclasses.astuple(first.statistics)
    for i, part in enumerate(cuts):
        try:
            events = first.decode(part, time_base)
        except RecordingError:
            return
        again = second.decode(np.frombuffer(bytearray(part), np.uint8), time_base)
        assert np.array_equal(events, again)
        assert len(events) <= MOST_EVENTS_OF_WORD.get(encoding, 1) * (len(part) // first.word.itemsize)
        assert (events["x"] < WIDTH).all()
        assert (events["y"] < HEIGHT).all()
        assert np.isin(events["p"], (0, 1)).all()
        assert (np.diff(events["t"]) >= 0).all()
        after = dataclasses.astuple(first.statistics)
        assert all(a >= b for a, b in zip(after, before, strict=True))
        before = after
        if i == 1:
            first.resynchronise()
            second.resynchronise()


def _words(dtype: str, words: list[int]) -> bytes:
    return np.array(words, dtype).tobytes()
