"""Lamps that flicker: what they add to the log intensity of everything that they light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.events import NS_PER_S
from esfo_simulation.sensor.photoreceptor import photoreceptor

Column = NDArray[np.float64]

_PARTS = 32
"""Parts of a period between which the log intensity is taken as linear; extremes fall on borders of parts."""


@dataclass(frozen=True)
class Flicker:
    """Illumination 1 + depth sin(2 pi hz t); hz 0 or depth 0: steady."""

    hz: float
    depth: float

    def borders(self, begin: float, end: float) -> Column:
        """Return begin, end and the times between them, ns, (S + 1,), that cut the sinusoid into parts."""
        if not self.hz or not self.depth:
            return np.array([begin, end])
        part = NS_PER_S / (self.hz * _PARTS)
        inner = part * np.arange(np.floor(begin / part) + 1, np.ceil(end / part))
        inner = inner[(inner > begin) & (inner < end)]
        return np.concatenate([[begin], inner, [end]])

    def at(self, times: Column) -> Column:
        """Return what the lamp adds to the log intensity at times (N,), ns: on the chords between the grid's points."""
        if not self.hz or not self.depth:
            return np.zeros(len(times))
        phase = times * (self.hz * _PARTS / NS_PER_S)
        low = np.floor(phase)
        levels = [np.log1p(self.depth * np.sin(2 * np.pi * (low + k) / _PARTS)) for k in (0, 1)]
        return np.asarray(levels[0] + (phase - low) * (levels[1] - levels[0]))


@njit(cache=True, nogil=True)
def low_pass(borders: Column, flicker: Column, signal: float, tau: float) -> Column:
    """Pass flicker (S + 1,) on constant light through a photoreceptor of time constant tau, ns.

    borders: (S + 1,) ns. signal: the filtered flicker at the first border. Returns it at all borders, (S + 1,).
    """
    out = np.empty(len(borders))
    out[0] = signal
    for s in range(len(borders) - 1):
        span = borders[s + 1] - borders[s]
        out[s + 1] = photoreceptor(out[s], flicker[s], (flicker[s + 1] - flicker[s]) / span, tau, span)
    return out
