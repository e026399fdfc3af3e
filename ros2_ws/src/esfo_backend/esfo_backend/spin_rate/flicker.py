"""Light that flickers: it changes all cells at once, which nothing that turns does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import rfft
from scipy.ndimage import median_filter

from esfo_backend.spin_rate.level_features import Features
from esfo_backend.spin_rate.period_refinement import fold
from esfo_core.events import NS_PER_S

_COMMON = 0.7
"""Share of the periodic activity that all cells have in common from which it is light."""
_CELLS = 6.0
"""Cells that must take part: few of them may change at once because a small thing turns."""
_LEAST_BINS, _PER_PERIOD = 128, 8
"""Bins of a level, and of a period, from which its spectrum is looked at."""
_LINE, _NEIGHBOURS = 20.0, 41
"""Power of a line over the median of so many frequencies about it."""
_MOST_PER_BIN = 2.0
"""Periods of the light in a bin from which they have averaged out."""
_HARMONICS, _BLOCK = 4, 30.0
"""Harmonics of the light that are taken out, and its periods over which they are taken for constant."""
_SIDEBANDS = 0.05
"""Relative distance from a light, or a multiple of it, within which what moves in it repeats by chance."""
_FEWEST = 8.0
"""Periods that must be seen: over few of them anything moves in common."""
_MAINS_HZ = (50.0, 60.0)
_NEAR = 0.01


@dataclass(frozen=True)
class Flicker:
    """rate_hz: of the light. common: share of the periodic activity that all cells have in common."""

    rate_hz: float
    common: float

    @property
    def mains_hz(self) -> float | None:
        """The frequency of the mains, Hz, of which it is a multiple; None: of neither."""
        for mains in _MAINS_HZ:
            multiple = round(self.rate_hz / mains)
            if multiple and abs(self.rate_hz / (multiple * mains) - 1) < _NEAR:
                return mains
        return None

    def __str__(self) -> str:
        of = f", from mains of {self.mains_hz:.0f} Hz" if self.mains_hz else ""
        return f"{self.rate_hz:.1f} Hz in all cells at once{of}"


def find_flicker(features: Sequence[Features]) -> Flicker | None:
    """Look for a line in the spectra that all cells have in the same phase, or the opposite; None: there is none.

    Cells that something passes have it at one time after another, in phases of all kinds.
    """
    best: tuple[float, Flicker] | None = None
    for level in features:
        found = _line(level)
        if found is not None and (best is None or found[0] > best[0]):
            best = found
    return None if best is None else best[1]


def _line(level: Features) -> tuple[float, Flicker] | None:
    """The strongest such line of a level, after how far it stands out from the spectrum about it."""
    n, columns = level.rows.shape
    if n < _LEAST_BINS or columns < _CELLS:
        return None
    spectrum = rfft(level.rows * np.hanning(n).astype(np.float32)[:, None], axis=0)
    spectrum = spectrum[: n // _PER_PERIOD]
    power = np.abs(spectrum.astype(np.complex128)) ** 2
    total = power.sum(axis=1)
    aligned = np.abs((spectrum.astype(np.complex128) ** 2).sum(axis=1)) / np.maximum(total, 1e-30)
    cells = total**2 / np.maximum((power**2).sum(axis=1), 1e-30)
    stands_out = total / np.maximum(median_filter(total, _NEIGHBOURS, mode="nearest"), 1e-30)
    light = (aligned > _COMMON) & (cells > _CELLS) & (stands_out > _LINE)
    light[: int(_FEWEST)] = light[-1:] = False
    if not light.any():
        return None
    at = int(np.argmax(np.where(light, total, 0.0)))
    left, middle, right = np.log(np.maximum(total[at - 1 : at + 2], 1e-30))
    curve = left - 2 * middle + right
    between = float(np.clip(0.5 * (left - right) / curve, -0.5, 0.5)) if curve < 0 else 0.0
    return float(stands_out[at]), Flicker((at + between) / n * NS_PER_S / level.bin, float(aligned[at]))


def without(features: Features, flicker: Flicker) -> Features:
    """Features without what repeats with the light, fitted anew every 30 of its periods: what it lights moves."""
    per_bin = flicker.rate_hz * features.bin / NS_PER_S
    if per_bin > _MOST_PER_BIN or len(features.rows) * per_bin < _FEWEST:
        return features
    harmonics = np.arange(1, max(int(0.5 / per_bin), 1) + 1)[:_HARMONICS]
    blocks = max(round(len(features.rows) * per_bin / _BLOCK), 1)
    cleaned = features.rows.copy()
    for part in np.array_split(np.arange(len(features.rows)), blocks):
        known = part[features.valid[part]]
        angle = 2 * np.pi * per_bin * known[:, None] * harmonics
        waves = np.hstack([np.cos(angle), np.sin(angle), np.ones((len(known), 1))])
        if len(known) <= 4 * waves.shape[1]:
            continue
        fitted = np.linalg.lstsq(waves, features.rows[known].astype(np.float64), rcond=None)[0]
        cleaned[known] -= (waves[:, :-1] @ fitted[:-1]).astype(np.float32)
    left = float((cleaned**2).sum(dtype=np.float64)) / max(float((features.rows**2).sum(dtype=np.float64)), 1e-30)
    noise = 1 - features.signal
    signal = max(1 - noise / left, 0.0) if left > 0 else 0.0
    return Features(features.t0, features.bin, cleaned, features.valid, features.events, signal)


def is_light(features: Features, lag: float, flicker: Flicker | None) -> bool:
    """Whether what repeats after `lag` bins is light: all cells change at once, or about as fast as a known light."""
    if flicker is not None:
        ratio = NS_PER_S / features.bin / lag / flicker.rate_hz
        if round(ratio) >= 1 and abs(ratio / round(ratio) - 1) < _SIDEBANDS:
            return True
    if len(features.rows) < _FEWEST * lag:
        return False
    common, cells = commonness(features, lag)
    return common > _COMMON and cells > _CELLS


def commonness(features: Features, lag: float) -> tuple[float, float]:
    """Share of the mean turn that all cells have in common, and the number of cells that take part.

    The common part is the first principal component of the mean turn: polarities may be opposite.
    """
    folded = fold(features, lag)
    mean = folded.rows.sum(axis=0) / np.maximum(folded.weight.sum(axis=0), 1)[:, None]
    mean -= mean.mean(axis=0)
    power = (mean.astype(np.float64) ** 2).sum(axis=0)
    if power.sum() <= 0:
        return 0.0, 0.0
    values = np.linalg.eigvalsh((mean @ mean.T).astype(np.float64))
    root = np.sqrt(power)
    return float(values[-1] / values.sum()), float(root.sum() ** 2 / power.sum())
