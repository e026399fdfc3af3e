"""The period to a small part of a bin, its standard deviation, and whether the rate is constant.

The features of all turns are laid over each other. A period that is wrong by a share e shifts a turn against the mean
of the turns, by e times the time between them: e is found by least squares, which is linear for small shifts. Phases
that were seen once tell nothing, those seen twice or more do, so that little more than one turn is enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from esfo_backend.spin_rate.level_features import SMOOTHING_BINS, Features
from esfo_core.orbit import Vector

_STEPS = 12
_MOST_STEP = 1.0
"""Bins by which the last turn may move in one step: shifts are linear in a part of the width of what moves."""
_GROUPS = 16
"""Groups of neighbouring phases, and of cells, whose scatter gives the standard deviation."""
_LEAST_DIFFERENCE = 0.005
"""Share of the variance of a turn in which turns must differ. Values between two bins are not exact to a thousandth,
and where so many turns are a whole number of bins, that repeats, too."""
_FEWEST_TURNS = 4
"""Turns from which their own scatter is measured, too: a rate that wanders, a camera that trembles."""


@dataclass(frozen=True)
class Folded:
    """Features (N, K, F) of turns n at phases k, their slopes per bin, weights (N, K): 1 where known, else 0."""

    rows: NDArray[np.float32]
    slopes: NDArray[np.float32]
    weight: NDArray[np.float32]


@dataclass(frozen=True)
class Refined:
    """A period and the turns that it was measured from.

    lag: period in bins, lag_std: its standard deviation. delays (N,): of the turns against an even rotation, bins, and
    delay_std (N,), NaN for turns not seen. sharpness: share of the squared slopes of the mean turn that is no noise.
    """

    lag: float
    lag_std: float
    delays: Vector
    delay_std: Vector
    sharpness: float


def fold(features: Features, lag: float) -> Folded:
    """Lay turns of `lag` bins over each other, as many phases as a turn has bins."""
    n = len(features.rows)
    phases = int(np.ceil(lag))
    turns = int(np.ceil(n / lag))
    at = (np.arange(turns)[:, None] + np.arange(phases) / phases) * lag
    known = at <= n - 3
    whole = np.clip(at.astype(np.int64), 1, n - 3)
    part = (np.clip(at, 1, n - 3) - whole).astype(np.float32)[..., None]
    p0, p1, p2, p3 = (features.rows[whole + k] for k in (-1, 0, 1, 2))
    a, b, c = 0.5 * (3 * (p1 - p2) + p3 - p0), p0 - 2.5 * p1 + 2 * p2 - 0.5 * p3, 0.5 * (p2 - p0)
    rows = ((a * part + b) * part + c) * part + p1
    slopes = (3 * a * part + 2 * b) * part + c
    weight = known & (at >= 1) & np.all([features.valid[whole + k] for k in (-1, 0, 1, 2)], axis=0)
    w = weight.astype(np.float32)
    return Folded(rows * w[..., None], slopes * w[..., None], w)


def refine(features: Features, lag: float) -> Refined | None:
    """Find the period near `lag` bins. None: no phase was seen twice, or the turns are not alike.

    First over few turns, then over more and more: what is left of the error may not shift the last turn by more than a
    bin or two.
    """
    turns = 2.0
    whole = len(features.rows) / lag
    while True:
        stop = min(int(np.ceil((turns + 0.5) * lag)), len(features.rows))
        part = features if stop == len(features.rows) else _part(features, stop)
        for _ in range(_STEPS):
            step = _step(part, lag)
            if step is None:
                break
            limit = _MOST_STEP / max(stop / lag, 1.0)
            lag += float(np.clip(step, -limit, limit))
            if abs(step) < 1e-3 * limit:
                break
        if turns >= whole:
            break
        turns *= 2
    return _with_deviation(features, lag)


def class_difference(folded: Folded, classes: int) -> float:
    """Significance, in standard deviations, with which every `classes`-th turn differs from the others; 0: too few.

    Where there are many turns, the difference of the turns in the first half of the recording from their neighbours is
    compared with that in the second half: noise, and a change over time, do not repeat. Where there are few, turns
    that many apart are compared with neighbours.
    """
    turns = len(folded.weight)
    if turns >= 4 * classes:
        half = turns // 2 // classes * classes
        halves = [_class_means(folded, first, half, classes) for first in (0, half)]
        product = (halves[0] * halves[1]).sum(axis=(0, 2), dtype=np.float64) / classes
        mean = folded.rows.sum(axis=0) / np.maximum(folded.weight.sum(axis=0), 1)[:, None]
        power = float((mean**2).sum(dtype=np.float64))
    elif turns > classes:
        n = turns - classes
        w = folded.weight[:n] * folded.weight[1 : n + 1] * folded.weight[classes:]
        gap = folded.rows[classes:] - folded.rows[1 : n + 1]
        product = ((folded.rows[:n] * gap).sum(axis=2) * w).sum(axis=0, dtype=np.float64)
        power = float(((folded.rows[:n] ** 2).sum(axis=2) * w).sum(dtype=np.float64))
        product = product[w.any(axis=0)]
    else:
        return 0.0
    if len(product) < _GROUPS or product.sum() < _LEAST_DIFFERENCE * power:
        return 0.0
    groups = np.array([g.sum() for g in np.array_split(product, _GROUPS)])
    spread = np.sqrt(((groups - groups.mean()) ** 2).sum() * len(groups) / (len(groups) - 1))
    return float(groups.sum() / spread) if spread > 0 else 0.0


def _class_means(folded: Folded, first: int, turns: int, classes: int) -> NDArray[np.float32]:
    """Mean of every class of turns minus the mean of all, (classes, K, F); zero where a class was not seen."""
    rows = folded.rows[first : first + turns].reshape(-1, classes, *folded.rows.shape[1:])
    weight = folded.weight[first : first + turns].reshape(-1, classes, folded.weight.shape[1])
    number = weight.sum(axis=0)[..., None]
    means = rows.sum(axis=0) / np.maximum(number, 1)
    seen = (number > 0).all(axis=0)
    return np.asarray((means - means.mean(axis=0)) * seen, np.float32)


def _part(features: Features, stop: int) -> Features:
    rows, valid = features.rows[:stop], features.valid[:stop]
    return Features(features.t0, features.bin, rows, valid, features.events, features.signal)


@dataclass(frozen=True)
class _Score:
    """Least squares of one parameter. each (N, K, F): its parts; information: their expected slope, free of noise.

    arm (N, K): turns from the mean turn of a phase. slope (K, F), residual (N, K, F): of the mean turn, from it.
    """

    each: NDArray[np.float32]
    information: float
    sharpness: float
    slope: NDArray[np.float32]
    residual: NDArray[np.float32]
    slope_power: Vector


def _score(features: Features, lag: float) -> _Score | None:
    """Parts of the sum whose zero is the best period."""
    f = fold(features, lag)
    number = f.weight.sum(axis=0)
    often = number >= 2
    if not often.any():
        return None
    count = np.maximum(number, 1)[:, None]
    mean, slope = f.rows.sum(axis=0) / count, f.slopes.sum(axis=0) / count
    n = np.arange(len(f.weight), dtype=np.float32)[:, None]
    arm = (n - (n * f.weight).sum(axis=0) / count[:, 0]) * f.weight * often
    residual = (f.rows - mean) * f.weight[..., None]
    each = residual * slope * arm[..., None]
    lever = (arm**2).sum(axis=0)
    # The slope of a mean of few turns is noisy, and its square too large by as much.
    freedom = max(float((f.weight * often).sum() - often.sum()), 1.0)
    noise = (residual**2).sum(axis=(0, 1), dtype=np.float64) / freedom
    false = noise / (2 * SMOOTHING_BINS**2)
    power = (slope.astype(np.float64) ** 2 - false / count) @ np.ones(slope.shape[1])
    observed = float((lever[:, None] * slope.astype(np.float64) ** 2).sum())
    information = float((lever * power).sum())
    sharpness = information / observed if observed > 0 else 0.0
    return _Score(each, information, sharpness, slope, residual, power)


def _step(features: Features, lag: float) -> float | None:
    score = _score(features, lag)
    if score is None or score.information <= 0:
        return None
    return float(-score.each.sum(dtype=np.float64) / score.information)


def _with_deviation(features: Features, lag: float) -> Refined | None:
    """Spread of the sum over phases, over cells and over turns: the largest counts, each sees other disturbances."""
    score = _score(features, lag)
    if score is None or score.information <= 0:
        return None
    by_phase = score.each.sum(axis=(0, 2), dtype=np.float64)
    by_cell = score.each.sum(axis=(0, 1), dtype=np.float64)
    by_turn = score.each.sum(axis=(1, 2), dtype=np.float64)
    spreads = [_spread(by_phase), _spread(by_cell)]
    power = score.slope_power
    seen = (np.abs(score.residual).sum(axis=2) > 0) @ power
    delays = -np.einsum("nkf,kf->n", score.residual, score.slope, dtype=np.float64) / np.where(seen > 0, seen, np.nan)
    turns = int((seen > 0.5 * power.sum()).sum())
    if turns >= _FEWEST_TURNS:
        spreads.append(float(np.sqrt((by_turn**2).sum() * turns / (turns - 2))))
    of_turn = score.residual * score.slope
    delay_std = np.array([_spread(s.sum(axis=1, dtype=np.float64)) for s in of_turn]) / np.where(seen > 0, seen, np.nan)
    return Refined(lag, max(spreads) / score.information, delays, delay_std, score.sharpness)


def _spread(parts: Vector) -> float:
    """Standard deviation of a sum from that of groups of neighbouring parts, about their mean."""
    groups = np.array([g.sum() for g in np.array_split(parts, min(_GROUPS, max(len(parts) // 3, 2)))])
    n = len(groups)
    return float(np.sqrt(((groups - groups.mean()) ** 2).sum() * n / (n - 1)))
