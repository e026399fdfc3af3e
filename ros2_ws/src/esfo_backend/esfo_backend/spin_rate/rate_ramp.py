"""The spin rate of an object that slows down or speeds up, from the event stream.

Time is warped so that a rate with a constant slope becomes constant, and the period of the warped stream is searched.
The estimate is the relative slope of highest correlation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.optimize import minimize_scalar

from esfo_backend.errors import BackendError
from esfo_backend.options import SpinRateOptions
from esfo_backend.orbit.observations import ObservationRows, Observations
from esfo_backend.spin_rate.correlation import SpinRate, autocorrelation, counts_of, features_of, peaks_of, period_of
from esfo_core.activity import Activity
from esfo_core.events import NS_PER_S
from esfo_core.orbit import Matrix, Vector

_MAX_CHANGE = 1.9
"""Largest change of the rate over the recording, relative to its mean; at 2 the rate is zero at one end."""
_SLOPES = 77
_REST = 0.15
"""Share of the peak activity below which the object is at rest at the beginning and the end of a recording."""
_SMOOTH_BINS = 5
_GROUPS = 8
_MAX_CELLS = 256
"""Limit on cells and polarities, because the correlation is computed some hundred times."""
_LAG_ERROR_BINS = 0.1
"""Error of a lag in bins that is common to all cells, so that the jackknife does not include it."""


@dataclass(frozen=True)
class RateRamp:
    """A rate with a constant slope: rate.rate_hz (1 + relative_slope s), s in seconds from `middle` (ns).

    relative_slope, relative_slope_std: slope of the rate over the rate, and its standard deviation, 1/s. span: ns, the
    part of the recording in which the object moves.
    """

    rate: SpinRate
    relative_slope: float
    relative_slope_std: float
    middle: int
    span: tuple[int, int]

    @property
    def slope(self) -> float:
        """Slope of the rate in Hz per second."""
        return self.rate.rate_hz * self.relative_slope

    @property
    def slope_std(self) -> float:
        """Standard deviation of the slope in Hz per second."""
        return self.rate.rate_hz * self.relative_slope_std

    def __str__(self) -> str:
        ends = " to ".join(f"{self.rate_at(t):.3f}" for t in self.span)
        return f"the spin rate is not constant: from {ends} Hz, {self.slope:+.4f} +- {self.slope_std:.4f} Hz per second"

    def rate_at(self, t: int) -> float:
        """Rate in Hz at t ns."""
        return self.rate.rate_hz * (1 + self.relative_slope * (t - self.middle) / NS_PER_S)


def find_rate_ramp(activity: Activity, options: SpinRateOptions) -> RateRamp:
    """Search slope and period together. Raises BackendError when the stream does not repeat at any slope."""
    moving = _moving(activity)
    counts = _busiest(counts_of(moving))
    duration = len(counts) * moving.bin / NS_PER_S

    def correlation(relative_slope: float, cells: NDArray[np.int64] | slice = slice(None)) -> float:
        return _best_correlation(features_of(_warped(counts[:, cells], duration, relative_slope)), options)

    slopes = np.linspace(-_MAX_CHANGE, _MAX_CHANGE, _SLOPES) / duration
    found = [correlation(relative_slope) for relative_slope in slopes]
    best = int(np.argmax(found))
    if found[best] < options.min_correlation:
        raise BackendError(f"the event stream does not repeat at any slope of the rate (correlation {found[best]:.2f})")
    relative_slope = _refined(correlation, slopes, best)
    rate = period_of(features_of(_warped(counts, duration, relative_slope)), moving.bin, options)
    step = (slopes[1] - slopes[0]) / 2
    std = _jackknife(counts, lambda cells: _vertex(lambda b: correlation(b, cells), relative_slope, step))
    # Slope x duration^2 / 8 is the warp of time in the middle relative to the ends.
    lag_error = 8 * _LAG_ERROR_BINS * moving.bin / NS_PER_S / duration**2
    middle = moving.t0 + len(counts) * moving.bin // 2
    return RateRamp(rate, relative_slope, float(np.hypot(std, lag_error)), middle, (moving.t0, moving.end))


def warp_times(obs: Observations, ramp: RateRamp) -> Observations:
    """Observations in `ramp.span` at warped times from `ramp.middle`, at which the rate is constant.

    Raises BackendError when no observation is in the span.
    """
    s = obs.rows.dt + (obs.t_ref - ramp.middle) / NS_PER_S
    limits = [(t - ramp.middle) / NS_PER_S for t in ramp.span]
    inside = obs.part((s >= limits[0]) & (s <= limits[1]), 2)
    if not inside.points:
        raise BackendError("no track is in the part of the recording in which the object moves")
    s = inside.rows.dt + (obs.t_ref - ramp.middle) / NS_PER_S
    _, xy, weight, first, focal = inside.rows
    return Observations(ObservationRows(s + ramp.relative_slope * s * s / 2, xy, weight, first, focal), ramp.middle)


def _moving(activity: Activity) -> Activity:
    """Remove the beginning and the end in which the object is at rest."""
    total = activity.counts.sum(axis=(1, 2, 3), dtype=np.float64)
    smooth = uniform_filter1d(total, _SMOOTH_BINS)
    busy = np.flatnonzero(smooth > _REST * smooth.max(initial=0.0))
    if not len(busy):
        raise BackendError("no events were counted")
    first, last = int(busy[0]), int(busy[-1]) + 1
    return activity.part(first, last)


def _busiest(counts: Matrix) -> Matrix:
    """The columns of (B, C) that vary most, in their order."""
    power = np.sqrt(counts).var(axis=0)
    return np.asarray(counts[:, np.sort(np.argsort(-power, kind="stable")[:_MAX_CELLS])])


def _warped(counts: Matrix, duration: float, relative_slope: float) -> Matrix:
    """Counts (B, C) in as many bins that are equal in w = s + relative_slope s^2 / 2, s seconds from the middle.

    Counts are taken as uniform within a bin.
    """
    edges = np.array([-duration, duration]) / 2
    low, high = edges + relative_slope * edges**2 / 2
    w = np.linspace(low, high, len(counts) + 1)
    # The root that is w at slope 0, in the form without cancellation.
    s = 2 * w / (1 + np.sqrt(np.maximum(1 + 2 * relative_slope * w, 0.0)))
    position = (s / duration + 0.5) * len(counts)
    total = np.concatenate([np.zeros((1, counts.shape[1])), np.cumsum(counts, axis=0)])
    whole = np.clip(position.astype(np.int64), 0, len(counts) - 1)
    part = (position - whole)[:, None]
    shared: Matrix = np.diff(total[whole] * (1 - part) + total[whole + 1] * part, axis=0)
    return np.maximum(shared, 0.0)


def _best_correlation(features: Matrix, options: SpinRateOptions) -> float:
    """Highest peak of the correlation of sufficient prominence above the minimum before it, -1 without one.

    A parabola interpolates between bins; otherwise slopes with a period of a whole number of bins are favoured.
    """
    if not features.shape[1]:
        return -1.0
    r = autocorrelation(features, int(len(features) * (1 - options.min_overlap)))
    peaks = peaks_of(r)
    prominent = peaks[r[peaks] - np.minimum.accumulate(r)[peaks] >= options.min_prominence]
    if not len(prominent):
        return -1.0
    left, top, right = r[prominent - 1], r[prominent], r[prominent + 1]
    return float((top + (left - right) ** 2 / (8 * np.maximum(2 * top - left - right, 1e-12))).max())


def _refined(correlation: Callable[[float], float], slopes: Vector, best: int) -> float:
    low, high = slopes[max(best - 1, 0)], slopes[min(best + 1, len(slopes) - 1)]
    found = minimize_scalar(
        lambda relative_slope: -correlation(relative_slope),
        bounds=(low, high),
        method="bounded",
        options={"xatol": 1e-3 * (high - low)},
    )
    return float(found.x)


def _vertex(correlation: Callable[[float], float], relative_slope: float, step: float) -> float:
    """Slope at the maximum of the parabola through the correlations at three slopes."""
    left, middle, right = (correlation(relative_slope + k * step) for k in (-1, 0, 1))
    curve = left - 2 * middle + right
    return relative_slope + step * float(np.clip(0.5 * (left - right) / curve, -1, 1)) if curve < 0 else relative_slope


def _jackknife(counts: Matrix, estimate: Callable[[NDArray[np.int64]], float]) -> float:
    """Standard deviation of an estimate from the cells, leaving out one of 8 groups of them at a time."""
    group = np.arange(counts.shape[1]) % _GROUPS
    values = np.array([estimate(np.flatnonzero(group != g)) for g in range(_GROUPS)])
    return float(np.sqrt((_GROUPS - 1) / _GROUPS * ((values - values.mean()) ** 2).sum()))
