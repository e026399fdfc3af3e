"""Periods at which the event stream repeats, looked for at all resolutions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from esfo_backend.spin_rate.level_features import Correlation, Features

_FEWEST_BINS = 12
"""Bins of the shortest period that a level shows; a shorter one is found on a finer level."""
_WITHIN, _LEAST_WITHIN = 0.15, 0.02
"""A peak is as good as the best of its level within this share of the mismatch of the best, and at least so much."""
VERIFY_BINS = 32
"""Fewest bins of a period at which it is verified: the coarsest such level has 32 to 128, and sees the most turns."""
LEAST_SIGNAL = 0.3
"""Share of the variance down to which a correlation is freed of counting noise: below it is more noise than signal."""
_REACH = 0.05
"""Relative difference of the periods that two levels may show."""
_AFTER = 0.25
"""Share of a period that must be seen after it for the valley there to count: it may not have come yet."""


@dataclass(frozen=True)
class Candidate:
    """A period seen at a level and verified on the level that sees most turns of it.

    lag: bins of the verifying level, number `level`. r: there. true_r: freed of counting noise. height: over the
    valleys before and after it. turns: that the level has seen. after: whether the valley after it was seen.
    """

    lag: float
    period_s: float
    level: int
    r: float
    true_r: float
    height: float
    turns: float
    after: bool


def first_periods(correlation: Correlation) -> NDArray[np.int64]:
    """Lags of the first peak that is about as high as the best of a level; none where there is no peak."""
    r = correlation.r
    peaks = peaks_of(r)
    if not len(peaks):
        return peaks
    best = r[peaks].max()
    near = max(_WITHIN * (1 - best), _LEAST_WITHIN)
    return np.asarray(peaks[r[peaks] >= best - near][:1])


def peaks_of(r: NDArray[np.float64]) -> NDArray[np.int64]:
    """Lags of local maxima after the first descent, 12 bins or more."""
    filled = np.where(np.isnan(r), -np.inf, r)
    middle, left, right = filled[1:-1], filled[:-2], filled[2:]
    top = 1 + np.flatnonzero((middle >= left) & (middle > right) & np.isfinite(left) & np.isfinite(right))
    rising = np.flatnonzero(filled[1:] > filled[:-1])
    first = max(_FEWEST_BINS, int(rising[0]) if len(rising) else len(r))
    return np.asarray(top[top >= first])


def verifying_level(levels: Sequence[Features], period_ns: float) -> int | None:
    """Number of the coarsest level whose bins divide a period finely enough; None: there is none."""
    fits = [k for k, level in enumerate(levels) if period_ns >= VERIFY_BINS * level.bin]
    return fits[-1] if fits else None


def verify(correlations: Sequence[Correlation], levels: Sequence[Features], period_ns: float) -> Candidate | None:
    """Look for a period where most turns of it are seen. None: it is no maximum there."""
    number = verifying_level(levels, period_ns)
    if number is None:
        return None
    correlation, level = correlations[number], levels[number]
    r = correlation.r
    lag = period_ns / level.bin
    low, high = max(int(lag * (1 - _REACH)) - 1, 1), min(int(np.ceil(lag * (1 + _REACH))) + 1, len(r) - 2)
    if high <= low or np.isnan(r[low - 1 : high + 2]).all():
        return None
    inner = np.nan_to_num(r[low : high + 1], nan=-1.0)
    at = low + int(np.argmax(inner))
    left, top, right = r[at - 1 : at + 2]
    if not (top >= left and top >= right):
        return None
    curve = left - 2 * top + right
    offset = 0.5 * (left - right) / curve if curve < 0 else 0.0
    height, after = _height(r, at)
    true_r = min(float(top) / max(correlation.signal, LEAST_SIGNAL), 1.0)
    exact = at + float(np.clip(offset, -0.5, 0.5))
    turns = len(level.rows) / exact
    return Candidate(exact, exact * level.bin / 1e9, number, float(top), true_r, height, turns, after)


def _height(r: NDArray[np.float64], lag: int) -> tuple[float, bool]:
    """Height of r[lag] over the higher of the lowest points before and after it, and whether both were seen."""
    before = float(np.nanmin(r[1:lag]))
    later = r[lag + 1 : lag + lag // 2]
    seen = int(np.isfinite(later).sum()) >= _AFTER * lag
    after = float(np.nanmin(later)) if seen else before
    return float(r[lag]) - max(before, after), seen


def candidates(correlations: Sequence[Correlation], levels: Sequence[Features]) -> list[Candidate]:
    """Verified periods, shortest first, each once."""
    found: list[Candidate] = []
    for correlation in correlations:
        for lag in first_periods(correlation):
            checked = verify(correlations, levels, float(lag) * correlation.bin)
            if checked and all(abs(checked.period_s / other.period_s - 1) > _REACH / 2 for other in found):
                found.append(checked)
    return sorted(found, key=lambda c: c.period_s)
