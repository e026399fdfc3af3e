"""Offset of the host's clock from a sensor's clock, estimated from the arrival of packets."""

from __future__ import annotations

from collections import deque

from esfo_core.events import NS_PER_S

WINDOW_NS = 10 * NS_PER_S
"""Sensor time after which a packet is forgotten; for this long, a forward step of a clock can go unnoticed."""

DRIFT = 10_000
"""Inverse of the fastest drift that is followed without lag, 100 ppm; oscillators drift less."""

JUMP_NS = NS_PER_S
"""A packet this far off the estimate has another clock: no transport within a machine takes so long."""

BUCKET_NS = WINDOW_NS // 1000
"""Packets within this sensor time count as one, which bounds the memory."""


class ClockOffset:
    """Running estimate of host time minus sensor time, ns.

    Transport delays packets and never hastens them, so that the truth lies along the lower envelope of their offsets
    (Moon, Skelly and Towsley, "Estimation and removal of clock skew from network delay measurements", INFOCOM 1999).
    Here the envelope is the least of offset + age / DRIFT over the packets of the latest `WINDOW_NS`. As long as the
    clocks drift by less than 1 / DRIFT it is never below the truth, and above it by no more than the least of
    delay + 2 age / DRIFT. Offsets that are all the same are returned exactly. The part common to all delays stays in
    the estimate: messages in one direction do not determine it.

    A packet off by more than `JUMP_NS`, or a step back of sensor time by more than that, restarts the estimate.
    Between such jumps the offset falls by no more than half the sensor time that has passed, so that later sensor
    times always get later host times. O(1) time per packet on average, at most `WINDOW_NS / BUCKET_NS` packets kept.
    """

    def __init__(self) -> None:
        self.value = 0
        self.jumps = 0
        # Sensor time and DRIFT * offset - sensor time, both growing from the oldest to the latest: the first is least.
        self._least: deque[tuple[int, int]] = deque()
        self._latest: int | None = None

    def update(self, sensor_t: int, host_t: int) -> int:
        """Take in a packet with the sensor time and the host time of one moment, ns; return the new offset.

        jumps counts the restarts of the estimate.
        """
        offset = host_t - sensor_t
        if self._latest is not None and (self._latest - sensor_t > JUMP_NS or abs(offset - self.value) > JUMP_NS):
            self.reset()
            self.jumps += 1
        if self._latest is None:
            self._latest, self.value = sensor_t, offset
        passed = max(sensor_t - self._latest, 0)
        self._latest += passed
        self._keep(self._latest, DRIFT * offset - sensor_t)
        estimate = (self._least[0][1] + self._latest) // DRIFT
        self.value = max(estimate, self.value - passed // 2)
        return self.value

    def reset(self) -> None:
        """Forget all packets; the offset is 0 until the next."""
        self.value, self._latest = 0, None
        self._least.clear()

    def _keep(self, t: int, key: int) -> None:
        """Add a packet to the ascending minima of the window, and drop those that can be least no more."""
        least = self._least
        while least and least[-1][1] >= key:
            least.pop()
        if not least or t // BUCKET_NS > least[-1][0] // BUCKET_NS:
            least.append((t, key))
        while least[0][0] < t - WINDOW_NS:
            least.popleft()
