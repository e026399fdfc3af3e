"""The event model: a pixel fires when its log intensity has moved by a threshold since its last event.

As in ESIM (Rebecq et al., CoRL 2018): between two rendered frames the log intensity is taken as linear, and the time of
each crossing is interpolated. Thresholds differ from pixel to pixel; background activity is a Poisson process.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.events import EventArray, make_events
from esfo_core.options import option
from esfo_core.simulation.renderer import Levels

Image = NDArray[np.float64]

_MICROSECOND = 1000


@dataclass(frozen=True)
class SensorOptions:
    """The pixel of an event camera."""

    threshold: float = option(0.3, "change of log intensity that makes an event", 0.02, 5.0)
    mismatch: float = option(0.03, "standard deviation of the threshold over the pixels, relative", 0.0, 0.3)
    refractory_us: float = option(100.0, "dead time of a pixel after an event, us", 0.0, 1e6)
    noise_hz: float = option(0.1, "background activity of a pixel, events per second", 0.0, 1e4)


@njit(cache=True, nogil=True)
def count_crossings(current: Image, reference: Image, threshold: Image) -> int:
    """Upper bound of the number of events that the step to `current` (H, W) makes."""
    total = 0
    for y in range(current.shape[0]):
        for x in range(current.shape[1]):
            total += int(abs(current[y, x] - reference[y, x]) / threshold[y, x]) + 1
    return total


@njit(cache=True, nogil=True)
def emit_crossings(
    frames: tuple[Image, Image],
    span: tuple[float, float],
    threshold: Image,
    refractory: float,
    state: tuple[Image, Image],
    out: NDArray[np.int64],
) -> int:
    """Write the events of one step into out (N, 4) as x, y, p, t in ns; return how many, pixel by pixel.

    frames: log intensity (H, W) at both ends of span, ns. threshold: (H, W). refractory: ns. state: reference level
    and time of the last event (H, W), changed in place. A crossing within the dead time moves the reference, but makes
    no event.
    """
    before, after = frames
    begin, end = span
    reference, last = state
    n = 0
    for y in range(before.shape[0]):
        for x in range(before.shape[1]):
            a, b, c = before[y, x], after[y, x], threshold[y, x]
            if a == b:
                continue
            sign = 1.0 if b > a else -1.0
            while sign * (b - reference[y, x]) >= c:
                reference[y, x] += sign * c
                # A level that the random start left behind the frame is crossed at once.
                share = min(max((reference[y, x] - a) / (b - a), 0.0), 1.0)
                t = begin + (end - begin) * share
                if t - last[y, x] >= refractory:
                    last[y, x] = t
                    out[n, 0], out[n, 1] = x, y
                    out[n, 2] = 1 if sign > 0 else 0
                    out[n, 3] = int(t)
                    n += 1
    return n


class Sensor:
    """Turns frames of a window of the sensor into events of the whole sensor."""

    def __init__(
        self,
        first: NDArray[np.uint16],
        levels: Levels,
        size: tuple[int, int],
        origin: tuple[int, int],
        options: SensorOptions,
        rng: np.random.Generator,
    ) -> None:
        """Begin with the frame `first` (H, W), whose upper left pixel is `origin` (x, y) of a sensor `size` (w, h)."""
        self._levels, self._size, self._origin, self._options, self._rng = levels, size, origin, options, rng
        before = levels.log_radiance(first)
        scatter = 1 + options.mismatch * rng.standard_normal(first.shape)
        self._threshold = options.threshold * np.maximum(scatter, 0.1)
        # Each pixel has moved by some part of a threshold since its last event before the recording.
        reference = before + self._threshold * rng.uniform(-1, 1, first.shape)
        self._state = (reference, np.full(first.shape, -np.inf))
        self._before = before

    def step(self, frame: NDArray[np.uint16], span: tuple[float, float]) -> EventArray:
        """Return the events, sorted by time, while the log intensity goes linearly to `frame` (H, W) over span, ns."""
        after = self._levels.log_radiance(frame)
        capacity = count_crossings(after, self._state[0], self._threshold)
        out = np.empty((capacity, 4), np.int64)
        refractory = self._options.refractory_us * _MICROSECOND
        n = emit_crossings((self._before, after), span, self._threshold, refractory, self._state, out)
        self._before = after
        out[:n, :2] += self._origin
        rows = np.concatenate([out[:n], self._noise(span)])
        rows[:, 3] -= rows[:, 3] % _MICROSECOND  # sensors give microseconds
        rows = rows[np.lexsort((rows[:, 2], rows[:, 0], rows[:, 1], rows[:, 3]))]
        return make_events(rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3])

    def _noise(self, span: tuple[float, float]) -> NDArray[np.int64]:
        width, height = self._size
        expected = self._options.noise_hz * width * height * (span[1] - span[0]) / 1e9
        n = int(self._rng.poisson(expected))
        columns = [self._rng.integers(0, high, n) for high in (width, height, 2)]
        return np.stack([*columns, self._rng.uniform(*span, n).astype(np.int64)], axis=1)
