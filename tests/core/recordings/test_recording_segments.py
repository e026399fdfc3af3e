"""A clock that is set back begins a new segment; one of them is read, the others are counted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_bags import event_bag, packet, some_events

from esfo_core.codecs import MAX_STEP_BACK, decoder, encode_mono
from esfo_core.codecs.base import part_starts
from esfo_core.errors import RecordingError
from esfo_core.events import make_events
from esfo_core.recordings import ReadingOptions, open_recording

SECOND = 1_000_000_000


def slow_part_starts(t, limit):
    """Plain twin of part_starts."""
    starts, part = [], [t[0]]
    for i in range(1, len(t)):
        if max(part) - t[i] > limit:
            starts.append(i)
            part = []
        part.append(t[i])
    return starts


@settings(max_examples=200, deadline=None)
@given(st.lists(st.integers(0, 200), min_size=1, max_size=40), st.integers(0, 100))
def test_parts_begin_where_time_is_set_back(times, limit):
    assert part_starts(np.array(times), limit).tolist() == slow_part_starts(times, limit)


def read(path, segment):
    recording = open_recording(path, options=ReadingOptions(segment=segment))
    return np.concatenate(list(recording.chunks())), recording.statistics


@pytest.mark.parametrize("segment", [0, 1, 2])
def test_segments_of_a_bag(tmp_path, segment):
    parts = [some_events(10, start=3 * SECOND), some_events(7, start=2 * SECOND), some_events(5, start=SECOND)]
    path = event_bag(tmp_path / "bag.mcap", *(packet(events, k) for k, events in enumerate(parts)))
    events, statistics = read(path, segment)
    assert (events == parts[segment]).all()
    assert statistics.segments == 3
    assert statistics.events == len(parts[segment])
    assert statistics.events_elsewhere == 22 - len(parts[segment])


@pytest.mark.parametrize("segment", [0, 1])
def test_a_jump_inside_a_block(tmp_path, segment):
    lines = [f"{k % 9},{k % 7},{k % 2},{t}" for k, t in enumerate([*range(900_000, 900_020), *range(100, 130)])]
    path = tmp_path / "events.csv"
    path.write_text("\n".join(lines) + "\n")
    events, statistics = read(path, segment)
    assert events["t"].tolist() == [1000 * t for t in ([*range(900_000, 900_020)], [*range(100, 130)])[segment]]
    assert (statistics.segments, statistics.events_elsewhere) == (2, 30 - 10 * segment if segment == 0 else 20)


def test_a_segment_that_is_not_there(tmp_path):
    path = event_bag(tmp_path / "bag.mcap", packet(some_events(10)))
    with pytest.raises(RecordingError, match="no segment 2: the clock is set back 0 times"):
        read(path, 2)


def test_times_at_random_are_no_recording(tmp_path):
    rng = np.random.default_rng(0)
    path = tmp_path / "events.csv"
    path.write_text("".join(f"1,2,1,{t}\n" for t in rng.integers(0, 10**9, 20_000)))
    with pytest.raises(RecordingError, match="contradict those around them"):
        read(path, 0)


SEGMENT_SIZES = [(40, 300, 60), (300, 40, 60), (60, 40, 300), (200, 201)]


@pytest.mark.parametrize("sizes", SEGMENT_SIZES)
def test_the_segment_with_the_most_events_is_read(tmp_path, sizes):
    parts = [some_events(n, start=(9 - k) * SECOND) for k, n in enumerate(sizes)]
    path = event_bag(tmp_path / "bag.mcap", *(packet(events, k) for k, events in enumerate(parts)))
    recording = open_recording(path)
    events = np.concatenate(list(recording.chunks()))
    assert recording.segment == np.argmax(sizes)
    assert (events == parts[recording.segment]).all()
    spans = [(len(p), p["t"][0], p["t"][-1]) for p in parts]
    assert [(s.events, s.first_t, s.last_t) for s in recording.statistics.stretches] == spans
    assert recording.statistics.events_elsewhere == sum(sizes) - max(sizes)


def test_a_first_segment_that_is_long_is_read_without_knowing_the_rest(tmp_path, monkeypatch):
    monkeypatch.setattr("esfo_core.recordings.recording.HELD_EVENTS", 100)
    parts = [some_events(200, start=2 * SECOND), some_events(150, start=SECOND), some_events(250, start=0)]
    bags = [event_bag(tmp_path / f"{n}.mcap", *(packet(e, k) for k, e in enumerate(parts[:n]))) for n in (2, 3)]
    recording = open_recording(bags[0])
    assert (np.concatenate(list(recording.chunks())) == parts[0]).all()
    got = []
    with pytest.raises(
        RecordingError, match=r"segment 2 has more events than the first.*segment 2 of 250 events in 0\.39"
    ):
        got.extend(open_recording(bags[1]).chunks())
    assert (np.concatenate(got) == parts[0]).all()


def test_a_live_packet_with_a_jump_is_refused_whole():
    t = np.array([SECOND, SECOND + 5, SECOND + 5 - MAX_STEP_BACK - 1])
    events = make_events(np.arange(3), np.arange(3), np.ones(3), t)
    data = encode_mono(events, SECOND // 2)
    with pytest.raises(RecordingError, match="steps back by"):
        decoder("mono", 64, 48).decode(data, SECOND // 2)
    assert [len(part) for part in decoder("mono", 64, 48).decode_parts(data, SECOND // 2)] == [2, 1]
