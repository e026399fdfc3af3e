"""The spin rate from the event stream itself, before any geometry.

Two ways: the paper's (section 5.1: strongest bin of the Fourier transform of the mean x of the events), and the
correlation of coarse event images at a lag, which is what `default` uses: an object that has turned once looks the
same again, so the lag of the highest correlation is the period, without the paper's 1/T wide bins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from esfo_backend.errors import BackendError
from esfo_backend.options import SpinRateOptions
from esfo_core.activity import Activity
from esfo_core.events import NS_PER_S
from esfo_core.orbit import Matrix, Vector

_UPSAMPLING = 16
_SMOOTHING_BINS = 1.5
_MOST_FEATURES = 512
"""Cells and polarities that take part, the most variable ones: the rest of a large sensor holds little but noise."""
_MARGIN = 8
"""Bins: the shortest period, and the reach of the interpolation at the ends of the recording."""
LARGEST_HARMONIC = 12
_AGREEMENT = 0.02
"""Relative difference of two rates above which they are not the same: a period is read to a small part of that."""
_REFINING_OVERLAP = 0.25
"""Share of the recording that images several periods apart must cover, for the period to be read from them."""
_VALLEY = 1.25
_CLEARLY = 3.0
"""Ratio of mismatches, 1 - r, that an activity which comes and goes cannot make."""
_LEAST_MISMATCH = 0.05
_WELL_SAMPLED = 32
"""Bins of a lag above which the correlation may be read between two of them."""


@dataclass(frozen=True)
class Harmonic:
    """Another period that the stream was tested for.

    z: significance, in standard deviations, with which the chosen period correlates better.
    """

    rate_hz: float
    correlation: float
    z: float


@dataclass(frozen=True)
class SpinRate:
    """The rate and how clearly the stream shows it.

    rate_hz: turns per second. correlation: of event images one period apart. prominence: height of the peak over
    the valleys beside it. harmonics: what else was considered, best first. rate_std_hz: standard deviation of the rate,
    NaN where it is not known.
    """

    rate_hz: float
    correlation: float
    prominence: float
    harmonics: tuple[Harmonic, ...]
    rate_std_hz: float = np.nan

    def agrees_with(self, rate_hz: float) -> bool:
        """Whether another estimate, of rate_hz, is of the same period."""
        return abs(rate_hz / self.rate_hz - 1) < _AGREEMENT


def fourier_rate(activity: Activity, window_s: float) -> float:
    """Rate in Hz of the strongest bin of the spectrum of the mean x (paper, section 5.1).

    Resolution is one over the length of the recording, and a symmetric object gives a multiple of its rate.
    Raises BackendError when there are fewer than four windows.
    """
    per_bin = activity.counts.sum(axis=(1, 2), dtype=np.float64)
    width = max(1, round(window_s * NS_PER_S / activity.bin))
    windows = len(per_bin) // width
    if windows < 4:
        raise BackendError(f"{len(per_bin)} bins of activity are too few for windows of {window_s} s")
    counts = per_bin[: windows * width].reshape(windows, width, -1).sum(axis=1)
    total = counts.sum(axis=1)
    seen = total > 0
    columns = np.arange(counts.shape[1])
    mean_x = np.zeros(windows)
    mean_x[seen] = counts[seen] @ columns / total[seen]
    mean_x[~seen] = mean_x[seen].mean() if seen.any() else 0.0
    power = np.abs(np.fft.rfft(mean_x - mean_x.mean())) ** 2
    return float((1 + np.argmax(power[1:])) / (windows * width * activity.bin / NS_PER_S))


def correlation_rate(activity: Activity, options: SpinRateOptions) -> SpinRate:
    """Rate in Hz from the lag at which the event images correlate best (method: docs/method.md).

    A multiple of the period correlates as well as the period itself, so the best lag is divided by 12, 11, .. 2 until
    the shorter lag is not significantly worse. Raises BackendError when no lag stands out: nothing here repeats.
    """
    return period_of(features_of(counts_of(activity)), activity.bin, options)


def period_of(features: Matrix, bin_ns: int, options: SpinRateOptions) -> SpinRate:
    """As `correlation_rate`, for features (B, F) of bins of bin_ns."""
    if features.shape[1] == 0 or len(features) < 4 * _MARGIN:
        raise BackendError(f"{len(features)} bins of activity are too few to look for a period")
    longest = int(len(features) * (1 - options.min_overlap))
    r = autocorrelation(features, longest)
    peaks = peaks_of(r)
    if not len(peaks):
        raise BackendError("the event stream does not repeat: its correlation has no peak")
    best = _interpolated_peak(features, int(peaks[np.argmax(r[peaks])]))
    in_hz = NS_PER_S / bin_ns
    lag, multiples = best, []
    shortest = float(peaks[0]) - 1  # before the first peak images are alike because little has moved
    for divisor in range(LARGEST_HARMONIC, 1, -1):
        if best / divisor < shortest or _clearly_worse(r, best, best / divisor):
            continue
        if _significance(features, best, best / divisor) < options.harmonic_z:
            lag = best / divisor
            multiples = [Harmonic(in_hz / best, _correlation(r, best), 0.0)]
            break
    correlation, prominence = _correlation(r, lag), _prominence(r, round(lag))
    if correlation < options.min_correlation or prominence < options.min_prominence:
        raise BackendError(
            f"the event stream does not repeat: best correlation {correlation:.2f} (prominence {prominence:.2f}) "
            f"at a lag of {lag / in_hz:.3f} s"
        )
    fractions = [
        Harmonic(k * in_hz / lag, _correlation(r, lag / k), _significance(features, lag, lag / k))
        for k in range(2, LARGEST_HARMONIC + 1)
        if lag / k >= shortest
    ]
    considered = sorted((h for h in multiples + fractions if h.correlation > 0), key=lambda h: -h.correlation)
    well_covered = min(longest, int(len(features) * (1 - _REFINING_OVERLAP)))
    return SpinRate(in_hz / _refine(features, r, lag, well_covered), correlation, prominence, tuple(considered))


def counts_of(activity: Activity) -> Matrix:
    """Counts (B, C) of every cell and polarity."""
    return np.asarray(activity.counts.reshape(len(activity.counts), -1), np.float64)


def features_of(counts: Matrix) -> Matrix:
    """(B, F) square roots of the counts (which evens out their Poisson noise), smoothed, mean over time removed.

    Smoothing over a few bins limits the band, so that lags between two bins can be interpolated.
    """
    flat = np.sqrt(np.maximum(counts, 0.0))
    power = flat.var(axis=0)
    busiest = np.sort(np.argsort(power, kind="stable")[::-1][:_MOST_FEATURES])
    smooth = gaussian_filter1d(flat[:, busiest[power[busiest] > 0]], _SMOOTHING_BINS, axis=0)
    return np.asarray(smooth - smooth.mean(axis=0))


def autocorrelation(features: Matrix, longest: int) -> Vector:
    """Correlation r (longest + 1,) of the images over lags in bins, each over the part where both exist."""
    n = len(features)
    spectrum = np.abs(np.fft.rfft(features, 2 * n, axis=0)) ** 2
    products = np.fft.irfft(spectrum.sum(axis=1), 2 * n)[: longest + 1]
    energy = np.concatenate([[0.0], np.cumsum((features**2).sum(axis=1))])
    lags = np.arange(longest + 1)
    norm = np.sqrt(energy[n - lags] * (energy[n] - energy[lags]))
    r: Vector = np.divide(products, norm, out=np.zeros(longest + 1), where=norm > 0)
    return r


def _correlation(r: Vector, lag: float) -> float:
    """Correlation at a lag between two bins."""
    return float(np.interp(lag, np.arange(len(r)), r))


def peaks_of(r: Vector) -> NDArray[np.int64]:
    """Local maxima of r after its first descent."""
    rising = np.flatnonzero(np.diff(r) > 0)
    if not len(rising):
        return np.empty(0, np.int64)
    inner = np.arange(max(_MARGIN, int(rising[0])), len(r) - 1)
    return np.asarray(inner[(r[inner] >= r[inner - 1]) & (r[inner] > r[inner + 1])])


def _prominence(r: Vector, lag: int) -> float:
    """Height of r[lag] over the lowest point before it, or after it within one lag if that is higher.

    What comes after counts only where a quarter of the lag or more was seen of it: the valley may not have come yet.
    """
    lag = min(lag, len(r) - 1)  # a peak at the end is interpolated to beyond it
    before, after = r[:lag].min(), r[lag : 2 * lag].min()
    if len(r) < _VALLEY * lag or after >= r[lag]:
        return float(r[lag] - before)
    return float(r[lag] - max(before, after))


def _significance(features: Matrix, lag: float, shorter: float) -> float:
    """Standard deviations by which images `lag` apart are more alike than images `shorter` apart.

    Under the hypothesis that both are periods the two differ from the reference image by noise alone, which is
    independent but for the smoothing.
    """
    n = len(features) - int(np.ceil(lag)) - _MARGIN
    if n <= 2 * _MARGIN:
        return np.inf
    # Blurred over a few degrees: a lag between two bins must not look worse than one on a bin.
    coarse = max(_SMOOTHING_BINS, min(4.0, 0.03 * shorter))
    features = gaussian_filter1d(features, np.sqrt(max(coarse**2 - _SMOOTHING_BINS**2, 1e-4)), axis=0)
    total, squares = _difference(np.ascontiguousarray(features), (_MARGIN, n), *_delay(lag), *_delay(shorter))
    spread = np.sqrt(2 * np.sqrt(np.pi) * coarse * squares)
    return float(total / spread) if spread > 0 else 0.0


def _clearly_worse(r: Vector, lag: float, shorter: float) -> bool:
    """Whether images `shorter` apart differ by more than noise, which is all by which images `lag` apart do.

    Each is seen over its whole overlap: while little more than one turn was seen, `_significance` has few rows to
    compare and finds nothing significant.
    """
    if shorter < _WELL_SAMPLED:
        return False
    noise = max(1 - _correlation(r, lag), _LEAST_MISMATCH)
    return 1 - _correlation(r, shorter) > _CLEARLY * noise


def _delay(lag: float) -> tuple[int, Vector]:
    """Band-limited interpolation at time + lag: offset of the first of 16 rows, and their weights.

    A windowed sinc (Kaiser, beta 8). Features have next to nothing above 0.3 cycles per bin, where it is exact to 1e-3.
    """
    whole = int(np.floor(lag))
    taps = np.arange(1 - _MARGIN, _MARGIN + 1)
    x = taps - (lag - whole)
    weights = np.sinc(x) * np.i0(8.0 * np.sqrt(np.maximum(1 - (x / _MARGIN) ** 2, 0.0)))
    return whole + 1 - _MARGIN, np.asarray(weights / weights.sum())


@njit(cache=True, nogil=True)
def _difference(
    features: Matrix, rows: tuple[int, int], first: int, a: Vector, second: int, b: Vector
) -> tuple[float, float]:
    """Sum, and sum of squares, of features(t) * (features(t + lag a) - features(t + lag b)) over rows and columns."""
    total = squares = 0.0
    gap = np.empty(features.shape[1])
    for k in range(rows[0], rows[1]):
        gap[:] = 0.0
        for i in range(len(a)):
            at_a, at_b = features[k + first + i], features[k + second + i]
            for j in range(len(gap)):
                gap[j] += a[i] * at_a[j] - b[i] * at_b[j]
        for j in range(len(gap)):
            product = features[k, j] * gap[j]
            total += product
            squares += product * product
    return total, squares


def _refine(features: Matrix, r: Vector, lag: float, longest: int) -> float:
    """Period in bins from the largest multiple of the lag that still correlates: that divides the error."""
    period = lag
    multiple = 2
    while multiple * period <= longest - 2:
        at = round(multiple * period)
        found = _interpolated_peak(features, at)
        if r[at] < 0.9 * r[round(lag)] or abs(found - at) > 2:
            break
        period = found / multiple
        multiple += 1
    return period


def _interpolated_peak(features: Matrix, lag: int) -> float:
    """Lag in bins of the maximum of the products near `lag`, by zero-padding the spectrum 16 times.

    All lags are compared over the same reference rows, so that the growing overlap does not pull the maximum.
    """
    margin = min(4, lag)
    n = len(features) - lag - margin
    if n < 2 * margin:
        return float(lag)
    reference, later = features[:n], features[lag - margin : lag + n + margin]
    size = 2 * len(later)
    cross = (np.conj(np.fft.rfft(reference, size, axis=0)) * np.fft.rfft(later, size, axis=0)).sum(axis=1)
    near = np.fft.irfft(cross, size * _UPSAMPLING)[: 2 * margin * _UPSAMPLING + 1]
    k = int(np.clip(np.argmax(near), 1, len(near) - 2))
    left, middle, right = near[k - 1 : k + 2]
    curve = left - 2 * middle + right
    below = 0.5 * (left - right) / curve if curve < 0 else 0.0
    return float(lag - margin + (k + below) / _UPSAMPLING)
