"""`esfo info`: what a recording holds."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path

import numpy as np

from esfo_bringup.commands.arguments import Commands
from esfo_bringup.progress import follow
from esfo_core.orbit import NANOSECONDS
from esfo_core.recordings import Recording, open_recording

_PEAK_WINDOW_NS = 10_000_000


def add_to(commands: Commands[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser("info", help="show what a recording holds")
    parser.add_argument("recording", type=Path)
    parser.set_defaults(execute=execute)


def execute(args: argparse.Namespace) -> int:
    """Read the whole recording and print what was met."""
    recording = open_recording(args.recording)
    peak = 0.0
    for events in follow(recording, recording.chunks(_PEAK_WINDOW_NS), "reading"):
        peak = max(peak, len(events) / (_PEAK_WINDOW_NS / NANOSECONDS))
    for name, value in _facts(recording, peak):
        print(f"{name:<12}{value}")
    return 0


def _facts(recording: Recording, peak: float) -> list[tuple[str, str]]:
    s = recording.statistics
    first, last = s.first_t or 0, s.last_t or 0
    duration = (last - first) / NANOSECONDS
    facts = [
        ("format", recording.format),
        ("sensor", f"{recording.width}x{recording.height} px"),
        ("camera", "in the recording" if recording.camera is not None else "none in the recording"),
        ("events", f"{s.events} ({s.events_on} on, {s.events - s.events_on} off)"),
        ("duration", f"{duration:.6f} s, sensor time {first / NANOSECONDS:.6f} to {last / NANOSECONDS:.6f} s"),
        ("rate", f"{s.events / max(duration, 1e-9) / 1e6:.3f} Mev/s mean, {peak / 1e6:.3f} Mev/s in the busiest 10 ms"),
        ("packets", f"{s.packets}, {s.packets_lost} lost, {s.packets_damaged} damaged, {s.bytes_lost} bytes cut off"),
        ("order", f"{s.out_of_order} events out of order between packets"),
    ]
    met = {k.replace("_", " "): v for k, v in asdict(s.decoder).items() if k != "events" and np.any(v)}
    if met:
        facts.append(("decoder", ", ".join(f"{v} {k}" for k, v in met.items())))
    return facts
