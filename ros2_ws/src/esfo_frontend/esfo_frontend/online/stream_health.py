"""Counts of a live stream, and its faults in words."""

from __future__ import annotations

from dataclasses import dataclass, field, fields


@dataclass
class LiveTotals:
    """Counts since the start or the last reset.

    packets taken in; lost: missing by their sequence numbers; unreadable: skipped; stale: skipped, because they were
    repeated or overtaken by others. restarts: streams that ended because their time went back far; renumbered: times
    that the sequence numbers began anew. events taken in; late: dropped, because they are older than events before
    them; outliers: dropped, because those around them in their packet contradict their time. observations and
    activity_bins that came out. alive: ids of the tracks that have rows and did not end.
    """

    packets: int = 0
    lost: int = 0
    unreadable: int = 0
    stale: int = 0
    restarts: int = 0
    renumbered: int = 0
    events: int = 0
    late: int = 0
    outliers: int = 0
    observations: int = 0
    activity_bins: int = 0
    alive: set[int] = field(default_factory=set)


@dataclass(frozen=True)
class Health:
    """State of the stream at one moment; the difference of two states gives the faults in between.

    Counts as in `LiveTotals`; dropped: packets that the node dropped because too many waited; clock_jumps: jumps
    between the clocks of sensor and host.
    """

    events: int
    dropped: int
    lost: int
    unreadable: int
    stale: int
    restarts: int
    renumbered: int
    late: int
    outliers: int
    clock_jumps: int

    @staticmethod
    def of(totals: LiveTotals, dropped: int, clock_jumps: int) -> Health:
        """Return the state that the totals have now."""
        counted = {field.name for field in fields(Health)} - {"dropped", "clock_jumps"}
        return Health(dropped=dropped, clock_jumps=clock_jumps, **{name: getattr(totals, name) for name in counted})

    def problems_since(self, earlier: Health, latest_error: str) -> dict[str, str]:
        """Return the faults since `earlier`, one text for each kind."""
        texts = {
            "dropped": "packets dropped: the front-end does not keep up",
            "lost": "packets lost on the way",
            "unreadable": f"packets unreadable, the last: {latest_error}",
            "stale": "packets repeated or overtaken by others, skipped",
            "restarts": "streams ended because the time of the events went back",
            "renumbered": "restarts of the packet numbers: losses at these are not known",
            "late": "late events dropped",
            "outliers": "events at times that those around them contradict, dropped",
            "clock_jumps": "jumps between the clocks of sensor and host",
        }
        counts = {name: getattr(self, name) - getattr(earlier, name) for name in texts}
        return {name: f"{counts[name]} {text}" for name, text in texts.items() if counts[name] > 0}
