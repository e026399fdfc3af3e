"""Light that flickers: it changes all cells at once, which nothing that turns does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from esfo_backend.spin_rate.level_features import Features, correlate
from esfo_backend.spin_rate.period_refinement import fold, refine
from esfo_backend.spin_rate.period_search import candidates
from esfo_core.events import NS_PER_S

_COMMON = 0.7
"""Share of the periodic activity that all cells have in common from which it is light."""
_CELLS = 6.0
"""Cells that must take part: few of them may change at once because a small thing turns."""
_REPEATS = 0.5
"""Least correlation, and height, of the sum of all cells."""
_MOST_PER_BIN = 2.0
"""Periods of the light in a bin from which they have averaged out."""
_HARMONICS, _BLOCK = 4, 300.0
"""Harmonics of the light that are taken out, and its periods over which they are taken for constant."""
_POWER_STEPS = 10
"""Of the power method, for the direction in which all cells change most: light is far stronger than the next one."""
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
    """Look for light in the sums of all cells, in which it is seen best; None: there is none."""
    sums = [_summed(level) for level in features]
    for c in candidates([correlate(level) for level in sums], sums):
        if c.true_r >= _REPEATS and c.height >= _REPEATS * c.r / c.true_r:
            found = flicker_of(features[c.level], c.lag)
            refined = refine(sums[c.level], c.lag)
            if found is not None and refined is not None:
                return Flicker(NS_PER_S / features[c.level].bin / refined.lag, found.common)
    return None


def without(features: Features, flicker: Flicker) -> Features:
    """Features without what repeats with the light, fitted anew every few hundred of its periods: mains drift."""
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


def _summed(level: Features) -> Features:
    """The mean of all cells along the direction in which they change together."""
    if not level.rows.shape[1]:
        return level
    direction = np.ones((level.rows.shape[1], 1), np.float32)
    for _ in range(_POWER_STEPS):
        direction = level.rows.T @ (level.rows @ direction)
        direction /= max(float(np.linalg.norm(direction)), 1e-30)
    return Features(level.t0, level.bin, level.rows @ direction, level.valid, level.events, 1.0)


def flicker_of(features: Features, lag: float) -> Flicker | None:
    """Whether what repeats after `lag` bins is light; None: it is not, or was seen too few times to tell."""
    if len(features.rows) < _FEWEST * lag:
        return None
    common, cells = commonness(features, lag)
    if common < _COMMON or cells < _CELLS:
        return None
    return Flicker(NS_PER_S / features.bin / lag, common)


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
