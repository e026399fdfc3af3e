"""An event sensor: frames of log intensity in, events out.

Pixels, noise and read-out are modules of their own; here they are put together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from esfo_core.errors import SimulationError
from esfo_core.events import NS_PER_S, EventArray
from esfo_core.options import check
from esfo_simulation.render.renderer import Levels
from esfo_simulation.sensor.illumination import Flicker, low_pass
from esfo_simulation.sensor.noise import ShotNoise, Variation, vary
from esfo_simulation.sensor.options import SensorOptions
from esfo_simulation.sensor.photoreceptor import time_constants
from esfo_simulation.sensor.pixels import Exposure, Response, expose, mark_active, renew_bands
from esfo_simulation.sensor.readout import ReadOut

Frame = NDArray[np.uint16]
Column = NDArray[np.float64]
Requests = tuple[Column, NDArray[np.int64]]

_BRIGHTEST = 65535
_BLOCK_NS = 2e7
_BAND_NS = 5e7
_FIRST_ROWS = 4096


class Patch:
    """Pixels that are carried through time together."""

    def __init__(
        self,
        places: NDArray[np.int64],
        light: Column,
        variation: Variation,
        response: Response,
        rng: np.random.Generator,
    ) -> None:
        """Begin at time 0 with pixels at `places` (N,), row by row, that have seen `light` (N,), log intensity."""
        mine = variation.at(places)
        n = len(places)
        self._response = response
        self._shots = ShotNoise(mine, rng)
        leak = mine.leak_hz * mine.on / NS_PER_S
        zero = np.zeros(n)
        self._state = np.stack([places, mine.on, mine.off, leak, light - mine.moved, light, zero, zero], axis=1)
        # Found at the first step, since they hold for no time.
        self._band = np.stack([np.zeros(n, np.int32), np.ones(n, np.int32)])
        self._active = np.empty(n, bool)
        self._valid = -np.inf
        self._rows = np.empty((_FIRST_ROWS, 2), np.int64)

    def expose(self, before: Frame, after: Frame, levels: Levels, lamp: tuple[Column, Column]) -> Requests:
        """Return the events of one step: times (M,) in ns and codes, see `ReadOut.push`.

        before, after: levels (N,) at both ends. lamp: borders and flicker, see `Exposure`.
        """
        borders, flicker = lamp
        begin, end = float(borders[0]), float(borders[-1])
        if end > self._valid:
            self._valid = end + _BAND_NS
            renew_bands(self._state, self._band, (levels.low, levels.step), self._valid)
        margin = (int(np.floor(flicker.min() / levels.step)), int(np.ceil(flicker.max() / levels.step)))
        exposure = Exposure(
            before, after, levels.low, levels.step, borders, flicker, margin, self._valid, self._response
        )
        shots = self._shots.between(begin, end)
        mark_active(self._band, exposure, self._active)
        self._active[shots.pixel] = True
        active = np.flatnonzero(self._active)
        self._rows = expose(self._state, self._band, active, exposure, shots, self._rows)
        rows = self._rows[1 : self._rows[0, 0] + 1]
        return rows[:, 0].astype(np.float64), rows[:, 1].copy()


class Surround:
    """The pixels outside the window, which see constant radiance under the same lamp: whole blocks of time at once."""

    def __init__(self, patch: Patch, level: int, count: int, levels: Levels, lamp: tuple[Flicker, float]) -> None:
        """Take `count` pixels that see `level`; lamp: the flicker, and the time constant of these pixels, ns."""
        self._patch, self._levels = patch, levels
        self._frame = np.full(count, level, np.uint16)
        self._flicker, self._tau = lamp
        self._signal, self._done = 0.0, 0.0
        self._waiting: Requests = (np.empty(0), np.empty(0, np.int64))

    def until(self, end: float) -> Requests:
        """Return the events from the last call to `end`, ns."""
        while self._done < end:
            self._block()
        times, codes = self._waiting
        ready = int(np.searchsorted(times, end))
        self._waiting = (times[ready:], codes[ready:])
        return times[:ready], codes[:ready]

    def _block(self) -> None:
        borders = self._flicker.borders(self._done, self._done + _BLOCK_NS)
        # All see the same light, so the low pass is computed once.
        signal = low_pass(borders, self._flicker.at(borders), self._signal, self._tau)
        times, codes = self._patch.expose(self._frame, self._frame, self._levels, (borders, signal))
        order = np.lexsort((codes, times))
        times, codes = (
            np.concatenate([self._waiting[0], times[order]]),
            np.concatenate([self._waiting[1], codes[order]]),
        )
        self._waiting = (times, codes)
        self._signal, self._done = float(signal[-1]), float(borders[-1])


class Sensor:
    """Turns frames of a window of the sensor into events of the whole sensor.

    Pixels outside the window see the radiance of the first frame's upper left pixel all the time. Everything follows
    from the frames, the options and the state of `rng`.
    """

    def __init__(
        self,
        first: Frame,
        levels: Levels,
        size: tuple[int, int],
        origin: tuple[int, int],
        options: SensorOptions,
        rng: np.random.Generator,
    ) -> None:
        """Begin with the frame `first` (H, W), whose upper left pixel is `origin` (x, y) of a sensor `size` (w, h).

        Raises OptionError for impossible options and SimulationError for a window that the sensor does not hold.
        """
        check(options)
        (width, height), (x, y) = size, origin
        if x < 0 or y < 0 or x + first.shape[1] > width or y + first.shape[0] > height:
            raise SimulationError(
                f"the window of {first.shape[1]}x{first.shape[0]} at {origin} is not on the {size} sensor"
            )
        streams = rng.spawn(4)
        inside = np.zeros((height, width), bool)
        inside[y : y + first.shape[0], x : x + first.shape[1]] = True
        window, surround = (np.flatnonzero(part) for part in (inside, ~inside))
        variation = vary(width * height, options, streams[0])
        response = _response(options, levels)
        self._flicker = Flicker(options.flicker_hz, options.flicker_depth)
        self._levels, self._options, self._width, self._jitter = levels, options, width, streams[3]
        self._window = Patch(window, levels.log_radiance(first).ravel(), variation, response, streams[1])
        around = np.full(len(surround), levels.low + int(first[0, 0]) * levels.step)
        patch = Patch(surround, around, variation, response._replace(tau=np.empty(0)), streams[2])
        tau = float(response.tau[first[0, 0]]) if options.bandwidth_hz else 0.0
        self._surround = Surround(patch, int(first[0, 0]), len(surround), levels, (self._flicker, tau))
        self._before = np.array(first)
        self._start: float | None = None
        self._now = 0.0
        self._read_out: ReadOut | None = None

    @property
    def dropped(self) -> int:
        """Events that the read-out has lost because its queue was full."""
        return self._read_out.dropped if self._read_out else 0

    def step(self, frame: Frame, span: tuple[float, float]) -> EventArray:
        """Return the events that leave while the log intensity goes linearly to `frame` (H, W) over span, ns.

        They are sorted by time, over all steps; a busy read-out stamps events later than the span's end. Raises
        SimulationError for a frame of another shape and for a span that does not follow the last one.
        """
        if frame.shape != self._before.shape:
            raise SimulationError(f"a frame of shape {frame.shape} follows one of {self._before.shape}")
        if self._read_out is None or self._start is None:
            self._start = span[0]
            self._now = span[0]
            self._read_out = ReadOut(self._width, int(span[0]), self._options, self._jitter)
        if span[0] != self._now or not span[1] > span[0]:
            raise SimulationError(f"the step {span[0]}..{span[1]} ns does not follow {self._now} ns")
        begin, end = span[0] - self._start, span[1] - self._start
        borders = self._flicker.borders(begin, end)
        after = np.array(frame)
        lamp = self._flicker.at(borders)
        events = self._window.expose(self._before.ravel(), after.ravel(), self._levels, (borders, lamp))
        parts = [events, self._surround.until(end)]
        self._before, self._now = after, span[1]
        times, codes = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        return self._read_out.push(times, codes, end)

    def flush(self) -> EventArray:
        """Return the events that the sensor still holds after the last step."""
        if self._read_out is None:
            raise SimulationError("the sensor has seen no step yet")
        return self._read_out.flush()


def _response(options: SensorOptions, levels: Levels) -> Response:
    light = levels.log_radiance(np.arange(_BRIGHTEST + 1, dtype=np.uint16))
    tau = time_constants(light, float(light[-1]), options.bandwidth_hz) if options.bandwidth_hz else np.empty(0)
    return Response(tau, float(light[-1]), options.refractory_us * 1e3)
