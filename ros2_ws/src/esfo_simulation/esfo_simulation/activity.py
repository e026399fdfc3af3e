"""Event activity of synthetic points, to test the search for the period without a camera simulation."""

from __future__ import annotations

import numpy as np

from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.events import NS_PER_S
from esfo_core.orbit import Matrix, Spin

_STEPS = 4
"""Positions per bin: a fast point crosses several cells in one bin."""
_EVENTS_PER_PX = 4.0


def synthetic_activity(
    spin: Spin, points: Matrix, camera: Camera, duration_s: float, bin_s: float = 0.005, cell: int = 32, seed: int = 0
) -> Activity:
    """Let each of (P, 3) surface points of a ball about `spin.center` make events while it faces the camera.

    A point makes Poisson-distributed counts, 4 for each pixel that it travels, of a polarity of its own; every cell
    gets noise of 0.05 events per bin.
    """
    rng = np.random.default_rng(seed)
    rows, columns = -(-camera.height // cell), -(-camera.width // cell)
    bins = round(duration_s / bin_s)
    polarity = rng.integers(0, 2, len(points))
    expected = np.full((bins, 2, rows, columns), 0.05)
    step_s = bin_s / _STEPS
    before = camera.project(spin.transform(points, spin.t0 - round(0.5 * step_s * NS_PER_S)))
    for k in range(bins * _STEPS):
        X = spin.transform(points, spin.t0 + round((k + 0.5) * step_s * NS_PER_S))
        uv = camera.project(X)
        facing = np.einsum("ij,ij->i", X - spin.center, X) < 0
        inside = facing & ((uv >= 0) & (uv < [camera.width, camera.height])).all(axis=1)
        travelled = np.linalg.norm(uv - before, axis=1)
        before = uv
        y, x = (uv[inside] // cell).astype(int).T[::-1]
        np.add.at(expected[k // _STEPS], (polarity[inside], y, x), _EVENTS_PER_PX * travelled[inside])
    counts = np.minimum(rng.poisson(expected), np.iinfo(np.uint16).max).astype(np.uint16)
    return Activity(spin.t0, round(bin_s * NS_PER_S), cell, counts)
