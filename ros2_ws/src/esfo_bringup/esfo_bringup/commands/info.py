"""`esfo info`: show the contents of a recording."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from esfo_bringup.commands.arguments import Commands
from esfo_bringup.commands.reading import add_reading_arguments, opened
from esfo_bringup.progress import follow
from esfo_core.events import NS_PER_S, EventArray
from esfo_core.recordings import Recording
from esfo_core.recordings.recording import MOST_EVENTS

PEAK_WINDOW_NS = 10_000_000
GAP_NS = 100_000_000
INFERRED = ", what the events need; the file tells no size (options width and height)"


@dataclass
class EventTiming:
    """Distribution of the events of a recording over time.

    peak: most events in one of the windows of `PEAK_WINDOW_NS`. gaps: stretches without events longer than `GAP_NS`;
    longest_gap and its start gap_start in ns.
    """

    peak: int = 0
    gaps: int = 0
    longest_gap: int = 0
    gap_start: int = 0
    _last: int | None = None

    def add(self, events: EventArray) -> None:
        """Take in the events (N,), N > 0, of the next window."""
        self.peak = max(self.peak, len(events))
        t = events["t"] if self._last is None else np.concatenate([[self._last], events["t"]])
        steps = np.diff(t)
        self.gaps += int(np.count_nonzero(steps > GAP_NS))
        if len(steps) and steps.max() > self.longest_gap:
            self.longest_gap, self.gap_start = int(steps.max()), int(t[np.argmax(steps)])
        self._last = int(t[-1])


def add_to(commands: Commands[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser("info", help="show what a recording holds")
    add_reading_arguments(parser)
    parser.set_defaults(execute=execute)


def execute(args: argparse.Namespace) -> int:
    """Read the whole recording and print its contents, times and losses."""
    recording = opened(args)
    timing = EventTiming()
    for events in follow(recording, recording.chunks(PEAK_WINDOW_NS), "reading"):
        timing.add(events)
    for name, value in [*_contents(recording), *_times(recording, timing), *_losses(recording)]:
        print(f"{name:<12}{value}")
    return 0


def _contents(recording: Recording) -> list[tuple[str, str]]:
    s = recording.statistics
    return [
        ("format", recording.format),
        ("sensor", f"{recording.width}x{recording.height} px{INFERRED if recording.size_inferred else ''}"),
        *(("found out", guess) for guess in recording.guesses),
        ("camera", _camera(recording)),
        ("events", f"{s.events} ({s.events_on} on, {s.events - s.events_on} off)"),
        ("triggers", f"{s.decoder.triggers_rising} rising, {s.decoder.triggers_falling} falling"),
    ]


def _camera(recording: Recording) -> str:
    if recording.unusable_camera is not None:
        return f"unusable: {recording.unusable_camera}"
    camera = recording.camera
    if camera is None:
        return "none in the recording"
    return f"in the recording, focal lengths {camera.K[0, 0]:g} and {camera.K[1, 1]:g} px, {camera.distortion_model}"


def _times(recording: Recording, timing: EventTiming) -> list[tuple[str, str]]:
    s = recording.statistics
    first, last = s.first_t or 0, s.last_t or 0
    duration = (last - first) / NS_PER_S
    mean = f"{s.events / duration / 1e6:.3f} Mev/s mean, " if duration else ""
    peak = timing.peak / (PEAK_WINDOW_NS / NS_PER_S) / 1e6
    gaps = f"{timing.gaps} without events for over {GAP_NS / NS_PER_S:g} s"
    if timing.gaps:
        start = (timing.gap_start - first) / NS_PER_S
        gaps += f", the longest {timing.longest_gap / NS_PER_S:.6f} s, {start:.6f} s after the first event"
    return [
        ("duration", f"{duration:.6f} s"),
        ("rate", f"{mean}{peak:.3f} Mev/s in the busiest {PEAK_WINDOW_NS / NS_PER_S:g} s"),
        ("sensor time", f"{first / NS_PER_S:.6f} to {last / NS_PER_S:.6f} s"),
        ("host time", _host_time(s.host_offset)),
        ("gaps", gaps),
    ]


def _host_time(offset: int | None) -> str:
    if offset is None:
        return "not in the recording"
    return f"sensor time {offset / NS_PER_S:+.6f} s, by the stamp of the first packet with events"


def _losses(recording: Recording) -> list[tuple[str, str]]:
    s, d = recording.statistics, recording.statistics.decoder
    order = f"{s.out_of_order + d.out_of_order} events out of order, sorted in"
    facts = [
        ("packets", f"{s.packets}, {s.packets_lost} lost, {s.packets_damaged} damaged, {s.bytes_lost} bytes cut off"),
        ("order", f"{order} ({d.out_of_order} inside packets, {s.out_of_order} between)"),
        ("clock", f"{s.outliers} events at times that those around them contradict, dropped"),
        ("range", f"{d.out_of_range} events outside the sensor, dropped"),
    ]
    decoding = {
        "events before the first time or address": d.unsynchronised,
        "words of no known code": d.unknown_words,
        "bytes that make no whole word": d.trailing_bytes,
        "events at impossible times": d.impossible_times,
    }
    if d.bad_lines:
        facts.append(("bad lines", f"{d.bad_lines} skipped; the first is {s.first_fault}"))
    if any(decoding.values()):
        facts.append(("skipped", ", ".join(f"{count} {name}" for name, count in decoding.items() if count)))
    return [*facts, *_segments(recording)]


def _segments(recording: Recording) -> list[tuple[str, str]]:
    stretches = recording.statistics.stretches
    if len(stretches) == 1:
        return []
    why = "the one with the most events" if recording.wanted_segment == MOST_EVENTS else "as asked for"
    facts = [
        (
            "segments",
            f"{len(stretches)}, the clock is set back; this is segment {recording.segment}, {why} "
            "(-p segment:=N reads another)",
        )
    ]
    for number, stretch in enumerate(stretches):
        seconds = (stretch.last_t - stretch.first_t) / NS_PER_S
        facts.append((f"segment {number}", f"{stretch.events} events, {seconds:.6f} s"))
    return facts
