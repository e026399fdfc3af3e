"""What is compared at different times: the activity of a level as features, with a mask of the bins that are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import gaussian_filter1d
from scipy.special import gammaln

from esfo_core.activity import Activity
from esfo_core.orbit import Vector

SMOOTHING_BINS = 1.5
"""Standard deviation. It limits the band, so that values between two bins can be interpolated."""
_MOST_COLUMNS = 256
"""Cells and polarities that take part, the most variable ones."""
_DARK, _DARK_MEDIAN = 0.02, 20.0
"""A bin with less than this share of the median count, where the median is above that, is missing: no object that is
seen all the time makes so few events."""
_LEAST_PAIRS = 0.1
"""Share of the bins that must be known at both ends of a lag."""
_LOCAL = 4.0
"""Smoothings over which the mean count is taken that tells the counting noise."""
_LEAST_ENERGY = 0.1
"""Variance of a part of the recording, relative to that of all, from which it can be compared."""
_NOISE_LEFT = 1 / (2 * np.sqrt(np.pi) * SMOOTHING_BINS)
"""Share of the variance of white noise that the smoothing leaves."""

Rows = NDArray[np.float32]


@dataclass(frozen=True)
class Features:
    """(B, F) rows of smoothed square roots of counts without their mean, zero where not valid (B,).

    bin: ns. t0: start of the first bin, ns. events: number counted. signal: share of their variance that is no
    counting noise. valid: known, together with the bins that the smoothing mixes in.
    """

    t0: int
    bin: int
    rows: Rows
    valid: NDArray[np.bool_]
    events: int
    signal: float

    @property
    def end(self) -> int:
        """Time just after the last bin, ns."""
        return self.t0 + self.bin * len(self.rows)


@dataclass(frozen=True)
class Correlation:
    """r (L,) at lags of 0 .. L - 1 bins, NaN where too few bins are known; bin: ns; signal: as in `Features`."""

    bin: int
    r: Vector
    signal: float


def masks_of(levels: Sequence[Activity]) -> list[NDArray[np.bool_]]:
    """Known bins of levels, finest first: a hole that a coarse level shows is one in the finer ones, too."""
    masks: list[NDArray[np.bool_]] = []
    holes: list[tuple[Activity, NDArray[np.bool_]]] = []
    for level in reversed(levels):
        total = level.counts.sum(axis=(1, 2, 3), dtype=np.float64)
        known = level.valid
        median = float(np.median(total[known])) if known.any() else 0.0
        dark = known & (total < _DARK * median) & (median > _DARK_MEDIAN)
        middle = level.t0 + level.bin * np.arange(len(total)) + level.bin // 2
        for coarse, empty in holes:
            at = (middle - coarse.t0) // coarse.bin
            inside = (at >= 0) & (at < len(empty))
            dark[inside] |= empty[at[inside]]
        masks.append(known & ~dark)
        holes.append((level, dark))
    return masks[::-1]


def features_of_level(activity: Activity, known: NDArray[np.bool_]) -> Features:
    """Features of one level; known (B,): its bins that are not missing."""
    counts = activity.counts.reshape(len(activity.counts), -1)
    flat = np.sqrt(counts, dtype=np.float32)
    n = max(int(known.sum()), 1)
    mean = flat[known].sum(axis=0) / n
    power = (flat[known] ** 2).sum(axis=0) / n - mean**2
    chosen = np.sort(np.argsort(-power, kind="stable")[:_MOST_COLUMNS])
    chosen = chosen[power[chosen] > 1e-9]
    flat, counts = flat[:, chosen], counts[:, chosen]
    weight = known.astype(np.float32)
    smooth = _smoothed(flat * weight[:, None])
    share = _smoothed(weight)
    smooth /= np.maximum(share, 0.05)[:, None]
    smooth -= smooth[known].sum(axis=0) / n
    smooth[~known] = 0
    events = int(counts[known].sum(dtype=np.int64))
    energy = float((smooth**2).sum(dtype=np.float64))
    local = counts[known].astype(np.float32) if energy > 0 else np.zeros((1, 1), np.float32)
    local = gaussian_filter1d(local, _LOCAL * SMOOTHING_BINS, axis=0, mode="nearest")
    noise = float(_variance_of_root(local).sum(dtype=np.float64)) * _NOISE_LEFT
    signal = max(1 - noise / energy, 0.0) if energy > 0 else 0.0
    return Features(activity.t0, activity.bin, smooth, known, events, signal)


def correlate(features: Features) -> Correlation:
    """Correlation of the features over lags, each over the pairs of bins that are both known.

    The means of the two parts that are compared are removed, otherwise rest would be like rest. Parts that hardly
    change cannot be compared.
    """
    rows, known = features.rows, features.valid
    n = len(rows)
    size = next_fast_len(2 * n, real=True)
    of_mask = rfft(known.astype(np.float64), size)
    pairs = np.maximum(np.round(irfft(np.abs(of_mask) ** 2, size)[:n]), 0.0)
    each = np.maximum(pairs, 1.0)
    of_energy = rfft((rows.astype(np.float64) ** 2).sum(axis=1), size)
    later = irfft(np.conj(of_mask) * of_energy, size)[:n]
    earlier = irfft(np.conj(of_energy) * of_mask, size)[:n]
    products = np.zeros(n)
    mask32 = of_mask.astype(np.complex64)[:, None]
    for first in range(0, rows.shape[1], 32):
        spectrum = rfft(rows[:, first : first + 32], size, axis=0)
        power = (spectrum.real**2 + spectrum.imag**2).sum(axis=1, dtype=np.float64)
        sums_later = irfft(np.conj(mask32) * spectrum, size, axis=0)[:n].astype(np.float64)
        sums_earlier = irfft(np.conj(spectrum) * mask32, size, axis=0)[:n].astype(np.float64)
        products += irfft(power, size)[:n] - (sums_later * sums_earlier).sum(axis=1) / each
        later -= (sums_later**2).sum(axis=1) / each
        earlier -= (sums_earlier**2).sum(axis=1) / each
    typical = pairs * max(float(later[0]), 1e-30) / max(float(pairs[0]), 1.0)
    enough = (pairs >= max(_LEAST_PAIRS * pairs[0], 2)) & (np.minimum(later, earlier) > _LEAST_ENERGY * typical)
    r = np.full(n, np.nan)
    r[enough] = products[enough] / np.sqrt(later[enough] * earlier[enough])
    return Correlation(features.bin, r, features.signal)


def _smoothed(rows: Rows) -> Rows:
    return np.asarray(gaussian_filter1d(rows, SMOOTHING_BINS, axis=0, mode="constant", truncate=3.0), np.float32)


def _table() -> tuple[Vector, Vector]:
    """Variance of the square root of a Poisson count over its mean."""
    mean = np.concatenate([np.linspace(0, 2, 81), np.linspace(2.1, 20, 180)])
    k = np.arange(100.0)
    p = np.exp(k * np.log(np.maximum(mean, 1e-300))[:, None] - mean[:, None] - gammaln(k + 1))
    return mean, mean - (p @ np.sqrt(k)) ** 2


_MEANS, _VARIANCES = _table()


def _variance_of_root(mean: Rows) -> NDArray[np.float64]:
    return np.interp(mean, _MEANS, _VARIANCES, right=0.25)
