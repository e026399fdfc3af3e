"""The read-out of an event sensor: latency, order, limited rate, and time stamps in whole microseconds."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.events import EventArray, make_events
from esfo_simulation.sensor.options import SensorOptions

Times = NDArray[np.float64]
Codes = NDArray[np.int64]

_MICROSECOND = 1000
_JITTER_LIMIT = 4.0
"""Jitter is cut off at so many standard deviations, so that events may leave once no earlier one can follow."""


@njit(cache=True, nogil=True)
def serve(requests: Times, service: float, capacity: int, free: float, stamps: Times) -> float:
    """Queue with one server: write the time at which each event is read, or NaN if it is dropped, into stamps (N,).

    requests: (N,) ns, sorted. service: time that one event takes, ns. capacity: events that may wait; 0: all. free:
    when the server is free, ns. Returns when it is free after the last one.
    """
    for k in range(len(requests)):
        # The event that is being read does not wait any more.
        if capacity > 0 and free - requests[k] > capacity * service:
            stamps[k] = np.nan
            continue
        stamps[k] = max(requests[k], free)
        free = stamps[k] + service
    return free


class ReadOut:
    """Takes events as pixels request them and gives them as they leave the sensor.

    dropped: events lost so far because the queue was full.
    """

    def __init__(self, width: int, origin_ns: int, options: SensorOptions, rng: np.random.Generator) -> None:
        """Set up for a sensor `width` pixels wide; the times that come in count from `origin_ns`."""
        self._width, self._origin, self._rng = width, origin_ns, rng
        self._jitter = options.jitter_us * _MICROSECOND
        self._service = _MICROSECOND / options.readout_mevs if options.readout_mevs else 0.0
        self._capacity = options.readout_queue
        self._free = -np.inf
        self._held: tuple[Times, Codes] = (np.empty(0), np.empty(0, np.int64))
        self.dropped = 0

    def push(self, times: Times, codes: Codes, until: float) -> EventArray:
        """Return the events that leave after more requests: times (N,) ns, codes (N,) 2 (y width + x) + polarity.

        No later request comes before `until`, ns. Sorted by time, also from one call to the next.
        """
        if self._jitter:
            noise = self._rng.standard_normal(len(times))
            times = times + self._jitter * np.clip(noise, -_JITTER_LIMIT, _JITTER_LIMIT)
        if len(self._held[0]):
            times, codes = np.concatenate([self._held[0], times]), np.concatenate([self._held[1], codes])
        order = np.lexsort((codes, times))
        times, codes = times[order], codes[order]
        ready = len(times)
        if self._jitter:
            ready = int(np.searchsorted(times, until - _JITTER_LIMIT * self._jitter))
        self._held = (times[ready:], codes[ready:])
        return self._leave(times[:ready], codes[:ready])

    def flush(self) -> EventArray:
        """Return the events that are still held."""
        times, codes = self._held
        self._held = (np.empty(0), np.empty(0, np.int64))
        return self._leave(times, codes)

    def _leave(self, times: Times, codes: Codes) -> EventArray:
        if self._service:
            stamps = np.empty(len(times))
            self._free = serve(times, self._service, self._capacity, self._free, stamps)
            kept = ~np.isnan(stamps)
            self.dropped += int(len(kept) - kept.sum())
            times, codes = stamps[kept], codes[kept]
        t = np.floor(times).astype(np.int64) + self._origin
        t -= t % _MICROSECOND
        place = codes >> 1
        return make_events(place % self._width, place // self._width, codes & 1, t)
