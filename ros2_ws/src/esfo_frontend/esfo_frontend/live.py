"""The front-end on a live stream of packets: what can go wrong with them is counted, and the stream goes on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from esfo_core.codecs import Decoder, decoder
from esfo_core.errors import EsfoError, RecordingError
from esfo_core.events import EventArray, empty_events
from esfo_core.options import option
from esfo_core.packets import Packet
from esfo_frontend.frontend import Frontend, FrontendOutput
from esfo_frontend.options import FrontendOptions

RESTART_NS = 1_000_000_000
"""Time going back by more than this is a new stream (a bag that loops); by less, events that are late."""


@dataclass(frozen=True)
class SubscriptionOptions:
    """Quality of service of the event packets."""

    reliability: str = option("best_effort", "QoS of the event packets", choices=("best_effort", "reliable"))
    depth: int = option(1000, "event packets that ROS keeps until they are taken", 1, 1_000_000)


@dataclass(frozen=True)
class LiveOptions:
    """How packets reach the front-end."""

    events: SubscriptionOptions = field(default_factory=SubscriptionOptions)
    queue: int = option(1000, "packets that may wait for the front-end; then the oldest is dropped", 1, 1_000_000)
    wait_for_back_end: bool = option(False, "take events only once a back-end, and whoever else is there, listens")
    min_listeners: int = option(1, "with wait_for_back_end: least listeners of tracks, and of activity", 1, 1000)
    idle_flush_s: float = option(2.0, "wall time without packets that ends the stream, s; 0: never", 0.0, 1e6)


@dataclass
class LiveTotals:
    """Counts since the start.

    packets taken in; lost: missing by their sequence numbers; unreadable: skipped. events taken in; late: dropped,
    because they are older than events before them. observations and activity_bins that came out. alive: ids of the
    tracks that have rows and did not end.
    """

    packets: int = 0
    lost: int = 0
    unreadable: int = 0
    events: int = 0
    late: int = 0
    observations: int = 0
    activity_bins: int = 0
    alive: set[int] = field(default_factory=set)


@dataclass(frozen=True)
class Health:
    """State of the stream at one moment; two of them give what happened between."""

    events: int
    dropped: int
    lost: int
    unreadable: int
    late: int

    def problems_since(self, earlier: Health, latest_error: str) -> str:
        """Say in one line what went wrong since `earlier`; empty when nothing did."""
        texts = {
            "dropped": "packets dropped: the front-end does not keep up",
            "lost": "packets lost on the way",
            "unreadable": f"packets unreadable, the last: {latest_error}",
            "late": "late events dropped",
        }
        counts = {name: getattr(self, name) - getattr(earlier, name) for name in texts}
        return "; ".join(f"{counts[name]} {text}" for name, text in texts.items() if counts[name])


class LiveFrontend:
    """Decodes packets, keeps them in order of time, and runs the front-end on them.

    totals: counts since the start. problem: the latest error of a packet, empty when there was none.
    events: those of the latest packet. last_t: sensor time of the latest event, ns. offset: host time minus sensor
    time at the start of the latest packet, ns. size: (width, height) of the sensor, zeros before the first packet.
    """

    def __init__(self, options: FrontendOptions) -> None:
        self.totals = LiveTotals()
        self.problem = ""
        self.events: EventArray = empty_events()
        self.offset = 0
        self.last_t = 0
        self.size = (0, 0)
        self._options = options
        self._form: tuple[int, int, str] | None = None
        self._decoder: Decoder
        self._frontend: Frontend
        self._arrived: int | None = None
        self._decoded: int | None = None
        self._running = False

    def arrived(self, seq: int) -> None:
        """Count the packets missing before this one. Called on arrival, when none has been dropped from a queue yet."""
        if self._arrived is not None:
            self.totals.lost += max(seq - self._arrived - 1, 0)
        self._arrived = seq

    def process(self, packet: Packet) -> Iterator[FrontendOutput]:
        """Take in one packet; yield what it settles, an ended stream first."""
        form = (packet.width, packet.height, packet.encoding)
        try:
            if form != self._form:
                yield from self.flush()
                self._begin(form)
            yield from self._settle(self._decode(packet))
        except EsfoError as error:
            self.totals.unreadable += 1
            self.problem = f"packet {packet.seq}: {error}"

    def flush(self) -> Iterator[FrontendOutput]:
        """End the stream; yield what was pending."""
        if self._form is not None:
            self._running = False
            yield self._counted(self._frontend.flush())

    @property
    def image_speed(self) -> float:
        """Typical speed of the tracks in the image, px/s; 0 before it is known and where clusters make the tracks."""
        return 0.0 if self._form is None else self._frontend.statistics.speed_px_s

    def health(self, dropped: int) -> Health:
        """Return the state of the stream; dropped: packets that were dropped before they came here."""
        t = self.totals
        return Health(t.events, dropped, t.lost, t.unreadable, t.late)

    def _begin(self, form: tuple[int, int, str]) -> None:
        width, height, encoding = form
        self._form = None  # should one of the next two fail, the next packet tries again
        self._decoder = decoder(encoding, width, height)
        self._frontend = Frontend(width, height, self._options)
        self._form, self.size = form, (width, height)

    def _decode(self, packet: Packet) -> EventArray:
        if self._decoded is not None and packet.seq != self._decoded + 1:
            self._decoder.resynchronise()
        self._decoded = packet.seq
        try:
            if packet.big_endian:
                raise RecordingError("big-endian data")
            events = self._decoder.decode(packet.data, packet.time_base)
        except RecordingError:
            self._decoder.resynchronise()
            raise
        self.totals.packets += 1
        if len(events):
            self.offset = packet.stamp - int(events["t"][0])
        return events

    def _settle(self, events: EventArray) -> Iterator[FrontendOutput]:
        if len(events) and self._running and events["t"][0] < self.last_t:
            if self.last_t - events["t"][0] > RESTART_NS:
                yield from self.flush()
            else:
                late = int(np.searchsorted(events["t"], self.last_t))
                self.totals.late += late
                events = events[late:]
        self.events = events
        if len(events):
            output = self._frontend.process(events)
            self.last_t, self._running = int(events["t"][-1]), True
            self.totals.events += len(events)
            yield self._counted(output)

    def _counted(self, output: FrontendOutput) -> FrontendOutput:
        self.totals.observations += len(output.tracks.observations)
        self.totals.alive.update(np.unique(output.tracks.observations.track_id).tolist())
        self.totals.alive.difference_update(output.tracks.ended.tolist())
        self.totals.activity_bins += 0 if output.activity is None else len(output.activity.counts)
        return output
