"""Replay of a recording: cuts it into packets and decides when each is sent."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from esfo_core.errors import EsfoError
from esfo_core.events import NS_PER_S, EventArray
from esfo_core.options import option
from esfo_core.recordings import ReadingOptions, Recording

PACKET_NS = 2_000_000
MAX_EVENTS = 16_384
"""Most events in a packet: 128 KiB, which the default transport delivers without loss."""


class ReplayError(EsfoError):
    """The events have no subscriber, or are not acknowledged."""


@dataclass(frozen=True)
class ReplayOptions:
    """Recording to play, and speed."""

    recording: str = option("", "path of the recording")
    topic: str = option("", "event topic of a bag with several; empty: the only one")
    reading: ReadingOptions = field(default_factory=ReadingOptions)
    camera: str = option("", "path of a camera_calibration YAML; empty: the calibration in the recording")
    frame_id: str = option("camera", "name of the camera's optical frame")
    rate: float = option(1.0, "speed relative to real time; 0: as fast as the front-end acknowledges", 0.0, 1e6)
    in_flight_s: float = option(0.3, "with rate 0: largest sensor time sent and not yet acknowledged, s", 0.01, 1e3)
    stall_s: float = option(
        60.0, "with rate 0: time without acknowledgement after which the node reports an error, s", 1.0, 1e6
    )
    loop: bool = option(False, "repeat the recording, with increasing times")
    wait_for_subscribers: int = option(
        1, "number of subscribers of `events` for which the node waits before it starts", 0, 1000
    )
    wait_timeout_s: float = option(60.0, "longest wait for these subscribers, s", 0.0, 1e6)


def packets(recording: Recording, loop: bool) -> Iterator[EventArray]:
    """Yield packets of up to 2 ms and `MAX_EVENTS`; with `loop`, the times of the next round follow the last event."""
    shift, last = 0, 0
    while True:
        first: int | None = None
        for chunk in recording.chunks(PACKET_NS):
            if shift:
                chunk["t"] += shift
            first, last = int(chunk["t"][0]) if first is None else first, int(chunk["t"][-1])
            yield from cut(chunk, first)
        if not loop or first is None:
            return
        shift += last - first + PACKET_NS


def cut(events: EventArray, first: int) -> Iterator[EventArray]:
    """Cut events (N,), N > 0, every `PACKET_NS` after `first`, ns, and where a packet would exceed `MAX_EVENTS`."""
    t = events["t"]
    start = int(t[0]) - (int(t[0]) - first) % PACKET_NS
    borders = np.searchsorted(t, np.arange(start + PACKET_NS, int(t[-1]) + 1, PACKET_NS))
    for piece in np.split(events, borders):
        for k in range(0, len(piece), MAX_EVENTS):
            yield piece[k : k + MAX_EVENTS]


class Pace:
    """Decides when a packet may be sent.

    With rate > 0 by the wall clock; with rate 0 while at most `in_flight_ns` of sensor time is not acknowledged.
    """

    def __init__(self, rate: float, in_flight_ns: int, stall_s: float) -> None:
        self._rate, self._in_flight_ns, self._stall_s = rate, in_flight_ns, stall_s
        self._start: tuple[int, float] | None = None
        self._sent: int | None = None
        self._acknowledged = 0
        self._progress = 0.0

    def delay(self, t: int, now: float) -> float:
        """Return the wall time in s to wait before sending events that begin at `t` ns; 0: send. now: wall time, s.

        Raises ReplayError when no event was acknowledged for `stall_s`.
        """
        if self._start is None:
            self._start, self._acknowledged, self._progress = (t, now), t, now
        if self._rate > 0:
            return max(0.0, (t - self._start[0]) / NS_PER_S / self._rate - (now - self._start[1]))
        if self._sent is None or self._sent - self._acknowledged <= self._in_flight_ns:
            return 0.0
        if now - self._progress > self._stall_s:
            raise ReplayError(f"no event after {self._acknowledged} ns was acknowledged for {self._stall_s:.0f} s")
        return 0.05

    def sensor_time(self, now: float) -> int:
        """Return the sensor time in ns at the wall time `now`, s; for rate > 0, after the first call of `delay`."""
        assert self._start is not None
        return self._start[0] + round((now - self._start[1]) * self._rate * NS_PER_S)

    def sent(self, t: int) -> None:
        """Note that events up to `t` ns have been sent."""
        self._sent = t

    def acknowledged(self, t: int, now: float) -> None:
        """Note that events before `t` ns have been processed."""
        if t > self._acknowledged:
            self._acknowledged, self._progress = t, now
