"""The front-end on a live stream of packets; faults of the stream are counted, and processing continues."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from esfo_core.camera import SensorSize
from esfo_core.codecs import MAX_STEP_BACK, Decoder, decoder
from esfo_core.codecs.time_check import without_outliers
from esfo_core.errors import EsfoError, RecordingError
from esfo_core.events import NS_PER_S, EventArray, empty_events
from esfo_core.options import option
from esfo_core.packets import Packet
from esfo_frontend.frontend import Frontend, FrontendOutput
from esfo_frontend.online.clock_offset import ClockOffset
from esfo_frontend.online.sequence_tracker import SequenceStep, SequenceTracker
from esfo_frontend.online.stream_health import Health, LiveTotals
from esfo_frontend.options import FrontendOptions, check_for_sensor, check_options

RESTART_NS = NS_PER_S
"""A step back in time by more than this begins a new stream (a bag that loops); after a smaller one, events are late.

Where the packets are numbered anew as well, `MAX_STEP_BACK` is enough.
"""

MAX_PIXELS = 2**24
"""Limit of the sensor size: a damaged packet may state a size that does not fit into memory."""


@dataclass(frozen=True)
class SubscriptionOptions:
    """Quality of service of the event packets."""

    reliability: str = option("best_effort", "QoS of the event packets", choices=("best_effort", "reliable"))
    depth: int = option(1000, "queue depth of the event subscription, packets", 1, 1_000_000)


@dataclass(frozen=True)
class FrontendNodeOptions:
    """How packets reach the front-end."""

    events: SubscriptionOptions = field(default_factory=SubscriptionOptions)
    queue: int = option(
        1000, "largest number of packets that wait for the front-end; then the oldest is dropped", 1, 1_000_000
    )
    wait_for_back_end: bool = option(False, "subscribe to events only after tracks and activity have subscribers")
    min_listeners: int = option(1, "with wait_for_back_end: smallest number of subscribers of each", 1, 1000)
    idle_flush_s: float = option(
        2.0, "wall time without packets after which the stream is ended, s; 0: never", 0.0, 1e6
    )
    camera_frame: str = option("camera", "camera frame used when the packets have no frame_id")


class LiveFrontend:
    """Decodes packets, keeps them in order of time, and runs the front-end on them.

    camera_frame: stands for the frame of packets that name none. totals: counts since the start or the last reset.
    problem: the latest error of a packet, empty when there was none. events: those of the latest packet. last_t: sensor
    time of the latest event, ns. size: (width, height) of the sensor, zeros before the first packet. frame_id: frame of
    the latest packet.
    """

    def __init__(self, options: FrontendOptions, camera_frame: str = FrontendNodeOptions.camera_frame) -> None:
        """Prepare for packets of any sensor. Raises OptionError for impossible options."""
        check_options(options)
        self.camera_frame = camera_frame
        self._wanted = self._options = options
        self._next_ids = (0, 0)
        self._frontend: Frontend | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the stream and what is pending; ids of clusters and tracks continue, so that none is used twice."""
        if self._frontend is not None:
            self._next_ids = self._frontend.next_ids
        self.totals = LiveTotals()
        self.problem = ""
        self.events: EventArray = empty_events()
        self.last_t = 0
        self.size = (0, 0)
        self.frame_id = self.camera_frame
        self._form: tuple[int, int, str] | None = None
        self._decoder: Decoder | None = None
        self._frontend = None
        self._running = self._gap = False
        self._clock = ClockOffset()
        self._arrivals, self._numbers = SequenceTracker(), SequenceTracker()

    def configure(self, options: FrontendOptions) -> None:
        """Use other options from the next packet on, which ends the stream before.

        Raises OptionError for options that are impossible, or for the sensor of this stream.
        """
        if self.size == (0, 0):
            check_options(options)
        else:
            check_for_sensor(options, *self.size)
        self._wanted = options

    def arrived(self, seq: int | None) -> None:
        """Count the packets missing before this one. Called on arrival, when none has been dropped from a queue yet.

        seq: None for a message without a number, or with one that cannot be read.
        """
        self._arrivals.take(seq)
        self.totals.lost, self.totals.renumbered = self._arrivals.lost, self._arrivals.restarts

    def resume(self) -> None:
        """Continue after a pause without a subscription: packets sent during it do not count as lost."""
        self._arrivals.forget()

    def process(self, packet: Packet) -> Iterator[FrontendOutput]:
        """Process one packet; yield what it settles, the output of an ended stream first."""
        step = self._numbers.take(packet.seq)
        form = (packet.width, packet.height, packet.encoding)
        if step is SequenceStep.STALE and form == self._form:
            self.totals.stale += 1
            return
        self._gap |= step is SequenceStep.GAP
        try:
            yield from self._prepare(form, step)
            self.frame_id = packet.frame_id or self.camera_frame
            self.events = empty_events()
            spent, most_late = 0, MAX_STEP_BACK if step is SequenceStep.RESTART else RESTART_NS
            for events in self._decode(packet):
                yield from self._end_if_back(events, most_late)
                yield from self._settle(events, packet, spent)
                spent += int(events["t"][-1] - events["t"][0]) if len(events) else 0
        except EsfoError as error:
            self.refuse(f"packet{'' if packet.seq is None else f' {packet.seq}'}: {error}")

    def refuse(self, why: str) -> None:
        """Count a packet that cannot be read."""
        self.totals.unreadable += 1
        self.problem = why

    def flush(self) -> Iterator[FrontendOutput]:
        """End the stream; yield what was pending."""
        if self._frontend is not None:
            self._running = False
            yield self._counted(self._frontend.flush())

    @property
    def offset(self) -> int:
        """Host time minus sensor time as the packets so far tell it, ns; 0 before the first."""
        return self._clock.value

    @property
    def image_speed(self) -> float:
        """Typical speed of the tracks in the image, px/s; 0 before it is known and where clusters make the tracks."""
        return 0.0 if self._frontend is None else self._frontend.statistics.speed_px_s

    def health(self, dropped: int) -> Health:
        """Return the state of the stream; dropped: packets that were dropped before they came here."""
        return Health.of(self.totals, dropped, self._clock.jumps)

    def _prepare(self, form: tuple[int, int, str], step: SequenceStep) -> Iterator[FrontendOutput]:
        """Create the decoder and the front-end that packets of `form` need; an error leaves all unchanged."""
        width, height, encoding = form
        if self._decoder is None or form != self._form or step is SequenceStep.RESTART:
            if width * height > MAX_PIXELS:
                raise RecordingError(f"sensor size {width}x{height} is impossible")
            new_decoder = decoder(encoding, width, height)
            check_for_sensor(self._wanted, width, height)
            if form != self._form:
                yield from self.flush()
            self._decoder = new_decoder
        elif step is SequenceStep.GAP:
            self._decoder.resynchronise()
        if self._frontend is None or (width, height) != self.size:
            if self._frontend is not None:
                self._next_ids = self._frontend.next_ids
            self._frontend = Frontend(SensorSize(width, height), self._wanted, self._next_ids)
        elif self._wanted is not self._options:
            yield from self.flush()
            self._frontend.configure(self._wanted)
        self._options, self._form, self.size = self._wanted, form, (width, height)

    def _decode(self, packet: Packet) -> list[EventArray]:
        assert self._decoder is not None
        try:
            if packet.big_endian:
                raise RecordingError("big-endian data")
            parts = self._decoder.decode_parts(packet.data, packet.time_base)
        except RecordingError:
            self._decoder.resynchronise()
            raise
        self.totals.packets += 1
        if len(parts) > 1:
            parts, outliers = without_outliers(parts)
            self.totals.outliers += outliers
        return parts

    def _end_if_back(self, events: EventArray, most_late: int) -> Iterator[FrontendOutput]:
        """End the stream when the events (N,) are earlier than its latest by more than `most_late` ns."""
        if self._running and len(events) and self.last_t - events["t"][0] > most_late:
            yield from self.flush()
            self._clock.reset()
            self.totals.restarts += 1

    def _settle(self, events: EventArray, packet: Packet, spent: int) -> Iterator[FrontendOutput]:
        """Take in events (N,) of a packet, sorted, after those of `spent` ns that the packet had before them."""
        if not len(events):
            return
        self._follow_clock(events, packet, spent)
        if self._running:
            late = int(np.searchsorted(events["t"], self.last_t))
            self.totals.late += late
            events = events[late:]
        self.events = events
        if len(events):
            assert self._frontend is not None
            if self._gap and self._running:
                self._frontend.miss(self.last_t, int(events["t"][0]))
            self._gap = False
            output = self._frontend.process(events)
            self.last_t, self._running = int(events["t"][-1]), True
            self.totals.events += len(events)
            yield self._counted(output)

    def _follow_clock(self, events: EventArray, packet: Packet, spent: int) -> None:
        if packet.stamp == 0:
            return  # the header is not filled in
        first, last = int(events["t"][0]), int(events["t"][-1])
        # Drivers stamp the first event; where events have host times, some stamp another, or the time of sending.
        moment = min(max(packet.stamp, first), last) if packet.host_times else first - spent
        self._clock.update(moment, packet.stamp)

    def _counted(self, output: FrontendOutput) -> FrontendOutput:
        self.totals.observations += len(output.tracks.observations)
        self.totals.alive.update(np.unique(output.tracks.observations.track_id).tolist())
        self.totals.alive.difference_update(output.tracks.ended.tolist())
        activity = () if output.activity is None else (output.activity,)
        self.totals.activity_bins += sum(int(piece.valid.sum()) for piece in (*activity, *output.pyramid))
        return output
