"""Which part of a recording turns steadily: rest, spin-up and spin-down are cut off."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from esfo_backend.spin_rate.level_features import Features

_ALIKE = 0.75
"""Correlation of a turn with the next one, relative to that of the best turns, above which it is as steady."""
_BEST = 0.75
"""Quantile of the turns that stands for the best."""
_REST = 0.1
"""Share of the median activity below which the object rests."""
_FEWEST_TURNS = 3.0
"""Turns of a stretch that is not the whole recording: a few alike are seen in any motion."""


def steady_stretch(features: Features, lag: float) -> tuple[int, int] | None:
    """First bin and bin after the last of the longest stretch in which each turn is like the next; None: none."""
    n, step = len(features.rows), round(lag)
    if n < 2 * step:
        return 0, n
    now, later = features.rows[: n - step], features.rows[step:]
    both = (features.valid[: n - step] & features.valid[step:]).astype(np.float64)
    sums = [
        uniform_filter1d(s.astype(np.float64) * both, step, mode="constant")
        for s in ((now * later).sum(axis=1), (now**2).sum(axis=1), (later**2).sum(axis=1))
    ]
    energy = np.sqrt(np.maximum(sums[1] * sums[2], 0))
    active = energy > _REST * np.median(energy[energy > 0]) if (energy > 0).any() else energy > 0
    if not active.any():
        return None
    r = np.where(active, sums[0] / np.where(active, energy, 1.0), -1.0)
    good = r >= _ALIKE * np.quantile(r[active], _BEST)
    # Nothing is known within a hole: it ends no stretch.
    unknown = uniform_filter1d(both, step, mode="constant") < 0.25
    good |= unknown
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(np.int8), [0]])))
    begin, end = max(zip(edges[::2], edges[1::2], strict=True), key=lambda e: int((~unknown[e[0] : e[1]]).sum()))
    begin = 0 if begin <= step // 2 else int(begin)
    end = n if end >= n - step - step // 2 else int(end) + step
    if end - begin < n and end - begin < _FEWEST_TURNS * lag:
        return None
    return begin, end


def cut(features: Features, begin: int, end: int) -> Features:
    """Bins begin:end."""
    if end - begin == len(features.rows):
        return features
    rows, valid = features.rows[begin:end], features.valid[begin:end]
    rows = rows - rows[valid].mean(axis=0) * valid[:, None] if valid.any() else rows
    t0 = features.t0 + begin * features.bin
    return Features(t0, features.bin, np.asarray(rows, np.float32), valid, features.events, features.signal)
