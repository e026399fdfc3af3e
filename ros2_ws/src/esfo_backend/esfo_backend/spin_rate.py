"""The spin rate from the event stream itself, before any geometry.

Two ways: the paper's (section 5.1: strongest bin of the Fourier transform of the mean x of the events), and the
correlation of coarse event images at a lag, which is what `default` uses: an object that has turned once looks the
same again, so the lag of the highest correlation is the period, without the paper's 1/T wide bins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from esfo_backend.errors import BackendError
from esfo_backend.options import SpinRateOptions
from esfo_core.activity import Activity
from esfo_core.orbit import NANOSECONDS, Vector

_UPSAMPLING = 16
_LARGEST_HARMONIC = 12


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
    the valleys beside it. harmonics: what else was considered, best first.
    """

    rate_hz: float
    correlation: float
    prominence: float
    harmonics: tuple[Harmonic, ...]


def fourier_rate(activity: Activity, window_s: float) -> float:
    """Rate in Hz of the strongest bin of the spectrum of the mean x (paper, section 5.1).

    Resolution is one over the length of the recording, and a symmetric object gives a multiple of its rate.
    Raises BackendError when there are fewer than four windows.
    """
    per_bin = activity.counts.sum(axis=(1, 2), dtype=np.float64)
    width = max(1, round(window_s * NANOSECONDS / activity.bin))
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
    return float((1 + np.argmax(power[1:])) / (windows * width * activity.bin / NANOSECONDS))


def correlation_rate(activity: Activity, options: SpinRateOptions) -> SpinRate:
    """Rate in Hz from the lag at which the event images correlate best (method: docs/method.md).

    A multiple of the period correlates as well as the period itself, so the peak is divided by 2..12 as long as the
    shorter lag is not significantly worse. Raises BackendError when no lag stands out: nothing here repeats.
    """
    features = _features(activity)
    if features.shape[1] == 0 or len(features) < 8:
        raise BackendError(f"{len(features)} bins of activity are too few to look for a period")
    longest = int(len(features) * (1 - options.min_overlap))
    r = _autocorrelation(features, longest)
    peaks = _peaks(r)
    if not len(peaks):
        raise BackendError("the event stream does not repeat: its correlation has no peak")
    best = int(peaks[np.argmax(r[peaks])])
    lag, harmonics = _fundamental(features, r, peaks, best, options)
    prominence = _prominence(r, lag)
    if r[lag] < options.min_correlation or prominence < options.min_prominence:
        raise BackendError(
            f"the event stream does not repeat: best correlation {r[lag]:.2f} (prominence {prominence:.2f}) "
            f"at a lag of {lag * activity.bin / NANOSECONDS:.3f} s"
        )
    bins = _refine(features, r, lag, longest)
    in_hz = NANOSECONDS / activity.bin
    return SpinRate(
        in_hz / bins,
        float(r[lag]),
        prominence,
        tuple(Harmonic(in_hz / h.rate_hz, h.correlation, h.z) for h in harmonics),
    )


def _features(activity: Activity) -> NDArray[np.float64]:
    """(B, F) square roots of the counts (which evens out their Poisson noise), mean over time removed."""
    flat = np.sqrt(activity.counts.reshape(len(activity.counts), -1).astype(np.float64))
    flat = flat[:, flat.any(axis=0)]
    return np.asarray(flat - flat.mean(axis=0))


def _autocorrelation(features: NDArray[np.float64], longest: int) -> Vector:
    """Correlation r (longest + 1,) of the images over lags in bins, each over the part where both exist."""
    n = len(features)
    spectrum = np.abs(np.fft.rfft(features, 2 * n, axis=0)) ** 2
    products = np.fft.irfft(spectrum.sum(axis=1), 2 * n)[: longest + 1]
    energy = np.concatenate([[0.0], np.cumsum((features**2).sum(axis=1))])
    lags = np.arange(longest + 1)
    norm = np.sqrt(energy[n - lags] * (energy[n] - energy[lags]))
    r: Vector = np.divide(products, norm, out=np.zeros(longest + 1), where=norm > 0)
    return r


def _peaks(r: Vector) -> NDArray[np.int64]:
    """Local maxima of r after its first descent."""
    rising = np.flatnonzero(np.diff(r) > 0)
    if not len(rising):
        return np.empty(0, np.int64)
    inner = np.arange(max(1, int(rising[0])), len(r) - 1)
    return np.asarray(inner[(r[inner] >= r[inner - 1]) & (r[inner] > r[inner + 1])])


def _prominence(r: Vector, lag: int) -> float:
    """Height of r[lag] over the higher of the lowest points on its two sides."""
    right = r[lag : min(len(r), 2 * lag)].min()
    return float(r[lag] - max(r[:lag].min(), right)) if right < r[lag] else float(r[lag] - r[:lag].min())


def _fundamental(
    features: NDArray[np.float64], r: Vector, peaks: NDArray[np.int64], best: int, options: SpinRateOptions
) -> tuple[int, list[Harmonic]]:
    """Divide the best lag while the shorter one explains the stream as well; list what was turned down.

    The harmonics carry lags in bins in place of rates.
    """
    lag = best
    tested: list[Harmonic] = []
    for divisor in range(_LARGEST_HARMONIC, 1, -1):
        near = peaks[np.abs(peaks - best / divisor) <= max(2.0, 0.02 * best / divisor)]
        if not len(near):
            continue
        shorter = int(near[np.argmax(r[near])])
        z = _significance(features, best, shorter)
        if z < options.harmonic_z:
            lag = shorter
            break
        tested.append(Harmonic(float(shorter), float(r[shorter]), z))
    if lag != best:
        # Divisors of the best lag that were turned down were compared with a lag of the same kind as the new one.
        tested = [h for h in tested if h.rate_hz < lag]
        tested.append(Harmonic(float(best), float(r[best]), 0.0))
    return lag, sorted(tested, key=lambda h: -h.correlation)


def _significance(features: NDArray[np.float64], lag: int, shorter: int) -> float:
    """Standard deviations by which images `lag` apart are more alike than images `shorter` apart.

    Under the hypothesis that both are periods the two differ from the reference image by noise alone.
    """
    n = len(features) - lag
    difference = features[:n] * (features[lag : lag + n] - features[shorter : shorter + n])
    spread = np.sqrt((difference**2).sum())
    return float(difference.sum() / spread) if spread > 0 else 0.0


def _refine(features: NDArray[np.float64], r: Vector, lag: int, longest: int) -> float:
    """Period in bins, below the bin, from the largest multiple of the lag that still correlates.

    The lag is read from the band-limited interpolation of the correlation: a parabola through three bins is biased by
    the fraction of a bin.
    """
    period = _interpolated_peak(features, lag)
    multiple = 2
    while multiple * period <= longest:
        guess = round(multiple * period)
        window = np.arange(max(guess - 2, 1), min(guess + 3, longest + 1))
        at = int(window[np.argmax(r[window])])
        if r[at] < 0.9 * r[lag] or at in (window[0], window[-1]):
            break
        period = _interpolated_peak(features, at) / multiple
        multiple += 1
    return period


def _interpolated_peak(features: NDArray[np.float64], lag: int) -> float:
    """Lag in bins of the maximum of the products near `lag`, by zero-padding the spectrum 16 times."""
    margin = 4
    n = len(features) - lag - margin
    if n < 2 * margin or lag < margin:
        return float(lag)
    reference, later = features[:n], features[lag - margin : lag + n + margin]
    size = 2 * len(later)
    cross = (np.conj(np.fft.rfft(reference, size, axis=0)) * np.fft.rfft(later, size, axis=0)).sum(axis=1)
    fine = np.fft.irfft(cross, size * _UPSAMPLING)
    near = fine[: (2 * margin + 1) * _UPSAMPLING]
    k = int(np.clip(np.argmax(near), 1, len(near) - 2))
    left, middle, right = near[k - 1 : k + 2]
    curve = left - 2 * middle + right
    below = 0.5 * (left - right) / curve if curve < 0 else 0.0
    return float(lag - margin + (k + below) / _UPSAMPLING)
