"""Light that flickers: it changes all cells at once, which nothing that turns does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from esfo_backend.spin_rate.level_features import Features, correlate
from esfo_backend.spin_rate.period_refinement import fold
from esfo_backend.spin_rate.period_search import candidates
from esfo_core.events import NS_PER_S

_COMMON = 0.7
"""Share of the periodic activity that all cells have in common from which it is light."""
_CELLS = 6.0
"""Cells that must take part: few of them may change at once because a small thing turns."""
_REPEATS = 0.5
"""Least correlation, and height, of the sum of all cells."""
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
            if found is not None:
                return found
    return None


def _summed(level: Features) -> Features:
    """The mean of all cells along the direction in which they change together."""
    if not level.rows.shape[1]:
        return level
    together = level.rows.T @ level.rows
    direction = np.linalg.eigh(together.astype(np.float64))[1][:, -1].astype(np.float32)
    rows = level.rows @ direction[:, None]
    return Features(level.t0, level.bin, rows, level.valid, level.events, 1.0)


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
