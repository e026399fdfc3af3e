"""Throughput of reading, corner detection and feature tracking, in one pass over a recording."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from esfo_bringup.progress import follow
from esfo_core.errors import RecordingError
from esfo_core.events import NS_PER_S
from esfo_core.recordings import Recording
from esfo_frontend.corners.detector import CornerDetector
from esfo_frontend.frontend import Frontend
from esfo_frontend.options import FrontendOptions
from esfo_frontend.warm_up import warm_up

STAGES = ("read", "corners", "front-end")
"""`corners` is the detector alone; `front-end` is the whole front-end with its detector, without reading."""


@dataclass
class Throughput:
    """Events and the CPU seconds of this process that each of STAGES takes; duration_s: of the recording."""

    recording: str
    events: int = 0
    duration_s: float = 0.0
    cpu_s: dict[str, float] = field(default_factory=lambda: dict.fromkeys(STAGES, 0.0))

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the CPU time that the body of the context takes."""
        begin = time.process_time()
        yield
        self.cpu_s[name] += time.process_time() - begin

    def mevs(self, stage: str) -> float:
        """Million events per CPU second."""
        return self.events / 1e6 / max(self.cpu_s[stage], 1e-9)

    @property
    def times_real_time(self) -> float:
        """Length of the recording over the CPU time of reading and the front-end together."""
        return self.duration_s / max(self.cpu_s["read"] + self.cpu_s["front-end"], 1e-9)

    def to_json(self) -> dict[str, Any]:
        """Return the values of the row by name."""
        return {
            "recording": self.recording,
            "events": self.events,
            "duration_s": self.duration_s,
            **{f"{stage}_mevs": self.mevs(stage) for stage in STAGES},
            "times_real_time": self.times_real_time,
        }


def measure_throughput(recording: Recording, options: FrontendOptions) -> Throughput:
    """Time the stages on a recording, chunk by chunk; the time to compile is not counted.

    Raises RecordingError for a recording without events.
    """
    warm_up(options)
    next(recording.chunks(), None)  # compiles the decoder; the measurement reads from the start again
    detector = CornerDetector(recording.width, recording.height, options.corners)
    frontend = Frontend(recording, options)
    found = Throughput(str(recording.path))
    first, last = None, 0
    chunks = follow(recording, recording.chunks(), "measuring")
    while True:
        with found.stage("read"):
            events = next(chunks, None)
        if events is None:
            break
        with found.stage("corners"):
            detector.detect(events)
        with found.stage("front-end"):
            frontend.process(events)
        found.events += len(events)
        first, last = int(events["t"][0]) if first is None else first, int(events["t"][-1])
    if first is None:
        raise RecordingError(f"{recording.path}: no events")
    with found.stage("front-end"):
        frontend.flush()
    found.duration_s = (last - first) / NS_PER_S
    return found


HEADER = (
    "| recording | events, M | s | read, Mev/s | corners | front-end | x real time |",
    "|---|---|---|---|---|---|---|",
)


def row_of(t: Throughput) -> str:
    """Return the row of one recording."""
    speeds = " | ".join(f"{t.mevs(stage):.2f}" for stage in STAGES)
    return f"| {t.recording} | {t.events / 1e6:.3f} | {t.duration_s:.2f} | {speeds} | {t.times_real_time:.2f} |"
