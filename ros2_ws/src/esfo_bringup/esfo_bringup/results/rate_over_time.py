"""Spin rate over the time of a recording, from the event stream alone: the time until each moment recurs.

It shows whether the rate is constant, as the estimate assumes; no track, point or axis is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from esfo_backend.spin_rate.correlation import counts_of, features_of
from esfo_core.activity import Activity
from esfo_core.events import NS_PER_S

_PER_TURN = 8
_LEAST_BINS = 12
_MOST = 160
_REACH = 0.15
"""Half width of the search interval about the rate, relative."""


@dataclass(frozen=True)
class RateOverTime:
    """Mean rates of single turns, rate_hz (K,), and middles of these turns, t_s (K,), s since the start of activity."""

    t_s: NDArray[np.float64]
    rate_hz: NDArray[np.float64]


def rate_over_time(activity: Activity, rate_hz: float) -> RateOverTime:
    """Find, for moments of an eighth of a turn, the lag near one turn with the highest correlation.

    rate_hz: centre of the search. Moments without a maximum inside the search interval are left out, so K may be 0.
    """
    features = features_of(counts_of(activity))
    per_second = NS_PER_S / activity.bin
    turn = per_second / rate_hz
    lags = np.arange(int(turn * (1 - _REACH)), int(turn * (1 + _REACH)) + 2)
    width = max(int(turn / _PER_TURN), _LEAST_BINS)
    last = len(features) - int(lags[-1]) - width
    if lags[0] < 2 or last < 0:
        return RateOverTime(np.empty(0), np.empty(0))
    found = []
    for start in np.unique(np.linspace(0, last, min(_MOST, last // width + 1)).astype(int)):
        lag = _lag(features, slice(start, start + width), lags)
        if lag is not None:
            found.append(((start + width / 2 + lag / 2) / per_second, per_second / lag))
    t, rate = np.array(found).reshape(-1, 2).T
    return RateOverTime(t, rate)


def _lag(features: NDArray[np.float64], rows: slice, lags: NDArray[np.int64]) -> float | None:
    """Lag in bins of the best correlation of the rows with later ones, refined by a parabola; None at the ends."""
    now = features[rows]
    later = np.stack([features[rows.start + lag : rows.stop + lag] for lag in lags])
    energy = (later**2).sum(axis=(1, 2))
    r = np.einsum("lbf,bf->l", later, now) / np.sqrt(np.where(energy > 0, energy, 1.0))
    k = int(np.argmax(r))
    if not 0 < k < len(r) - 1 or r[k] <= 0:
        return None
    left, middle, right = r[k - 1 : k + 2]
    return float(lags[k] + 0.5 * (left - right) / (left - 2 * middle + right))
