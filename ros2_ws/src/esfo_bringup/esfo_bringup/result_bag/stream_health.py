"""Health of the event stream of an offline run, once a second, for /diagnostics in a bag."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from esfo_core.events import NS_PER_S, EventArray
from esfo_core.recordings import Recording
from esfo_frontend.frontend import FrontendOutput

_PERIOD_NS = NS_PER_S


@dataclass(frozen=True)
class HealthReport:
    """State at the sensor time `t` in ns. problems: losses in the second before, by kind; counts: since the start."""

    t: int
    problems: dict[str, str]
    counts: dict[str, object]


class StreamHealth:
    """Counts events and observations, and what the reader of the recording lost."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._due: int | None = None
        self._events = self._reported_events = self._observations = 0
        self._reported_losses: Mapping[str, int] = {}

    def add(self, events: EventArray, output: FrontendOutput) -> HealthReport | None:
        """Count a chunk of events (N,) and what it settled; return a report once a second."""
        self._events += len(events)
        self._observations += len(output.tracks.observations)
        if not len(events):
            return None
        t = int(events["t"][-1])
        self._due = int(events["t"][0]) + _PERIOD_NS if self._due is None else self._due
        return self._report(t) if t >= self._due else None

    def _report(self, t: int) -> HealthReport:
        losses = self._losses()
        new = {name: count - self._reported_losses.get(name, 0) for name, count in losses.items()}
        counts: dict[str, object] = {
            "Mev/s in": (self._events - self._reported_events) / 1e6,
            "events": self._events,
            "observations": self._observations,
            **losses,
        }
        self._reported_events, self._reported_losses, self._due = self._events, losses, t + _PERIOD_NS
        return HealthReport(t, {name: f"{count} {name}" for name, count in new.items() if count}, counts)

    def _losses(self) -> dict[str, int]:
        s = self._recording.statistics
        return {
            "packets lost": s.packets_lost,
            "packets unreadable": s.packets_damaged,
            "events outside the sensor": s.decoder.out_of_range,
        }
