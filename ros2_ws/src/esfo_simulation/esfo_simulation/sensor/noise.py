"""Mismatch between the pixels of a sensor, and their noise events (v2e, Hu et al., CVPRW 2021)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from esfo_core.events import NS_PER_S
from esfo_simulation.sensor.options import SensorOptions
from esfo_simulation.sensor.pixels import Shots

Column = NDArray[np.float64]

_LEAST_THRESHOLD = 0.1
"""Relative to the nominal one: mismatch makes no pixel that fires without end."""


@dataclass(frozen=True)
class Variation:
    """Properties of N pixels, one column (N,) each.

    on, off: thresholds, log intensity. leak_hz, shot_hz: noise rates in the dark. hot: whether a pixel is hot.
    moved: log intensity by which its light differs from its reference at the beginning.
    """

    on: Column
    off: Column
    leak_hz: Column
    shot_hz: Column
    hot: NDArray[np.bool_]
    moved: Column

    def at(self, places: NDArray[np.int64]) -> Variation:
        """Return those of the pixels `places` (M,)."""
        return Variation(*(getattr(self, name)[places] for name in self.__dataclass_fields__))


def vary(n: int, options: SensorOptions, rng: np.random.Generator) -> Variation:
    """Draw n pixels: thresholds scatter independently, noise rates as a log-normal of the mean asked for."""
    on, off = (
        nominal * np.maximum(1 + options.mismatch * rng.standard_normal(n), _LEAST_THRESHOLD)
        for nominal in (options.threshold_on, options.threshold_off)
    )
    sigma = options.noise_spread * np.log(10)
    leak, shot = (
        rate * np.exp(sigma * rng.standard_normal(n) - 0.5 * sigma**2) for rate in (options.leak_hz, options.shot_hz)
    )
    hot = np.zeros(n, bool)
    hot[rng.choice(n, round(options.hot_pixels * n), replace=False)] = True
    rates = options.hot_hz * np.exp(sigma * rng.standard_normal(n) - 0.5 * sigma**2)
    (leak if options.hot_kind == "leak" else shot)[hot] = rates[hot]
    # Where a reference leaks, a pixel at rest has fired ON last; elsewhere the last event may be of either kind.
    moved = rng.uniform(np.where(leak > 0, 0.0, -off), on)
    return Variation(on, off, leak, shot, hot, moved)


class ShotNoise:
    """Draws the candidates of shot noise of N pixels."""

    def __init__(self, variation: Variation, rng: np.random.Generator) -> None:
        self._cumulative = np.cumsum(variation.shot_hz)
        self._hot, self._rng = variation.hot, rng

    def between(self, begin: float, end: float) -> Shots:
        """Return the candidates from begin to end, ns: a Poisson process at each pixel's rate in the dark."""
        total = self._cumulative[-1] if len(self._cumulative) else 0.0
        n = int(self._rng.poisson(total * (end - begin) / NS_PER_S))
        pixel = np.searchsorted(self._cumulative, self._rng.uniform(0, total, n), side="right")
        time = self._rng.uniform(begin, end, n)
        order = np.lexsort((time, pixel))
        pixel, time = pixel[order], time[order]
        # The rate of a hot pixel is what was asked for, in any light.
        level = np.where(self._hot[pixel], 0.0, self._rng.uniform(0, 1, n))
        return Shots(pixel.astype(np.int64), time, self._rng.integers(0, 2, n), level)
