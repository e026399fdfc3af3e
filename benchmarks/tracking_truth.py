"""True poses of simulated motions for the evaluation of tracks, and where tracks are against true corners."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from esfo_core.camera import Camera
from esfo_core.evaluation.track_error import FittedTracks, WorldToCamera
from esfo_simulation.motion import RigidMotion


def poses_of(motion: RigidMotion) -> WorldToCamera:
    """Return the poses of a simulated motion at many times."""

    def at(t: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        poses = [motion.pose(float(v)) for v in t]
        R = np.array([p[0] for p in poses]).reshape(-1, 3, 3)
        return R, np.array([p[1] for p in poses]).reshape(-1, 3)

    return at


def places(fitted: FittedTracks, times: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return where the good tracks (G) are at `times` (N,) ns, (N, G, 2) px: between rows, and NaN outside of them."""
    chosen = np.flatnonzero(fitted.good)
    result = np.full((len(times), len(chosen), 2), np.nan)
    first = np.concatenate([[0], np.cumsum(fitted.count)])
    for j, k in enumerate(chosen):
        rows = slice(first[k], first[k + 1])
        living = (times >= fitted.begin[k]) & (times <= fitted.end[k])
        for axis in (0, 1):
            t, uv = fitted.tracks.t[rows], fitted.tracks.uv[rows, axis]
            result[living, j, axis] = np.interp(times[living], t, uv)
    return result


def offset_to_corners(fitted: FittedTracks, corners: NDArray[np.float64], camera: Camera, motion: RigidMotion) -> str:
    """Compare the rows of good tracks with the nearest true corner (M, 3) within 6 px that is alone there.

    Returns the median offset along and across the motion, and its spread: a lag shows as a negative offset along it.
    """
    rows = np.flatnonzero(fitted.good[fitted.index])
    inner = rows[(rows > 0) & (rows < len(fitted.index) - 1)]
    inner = inner[(fitted.index[inner - 1] == fitted.index[inner + 1])][::7]
    uv, t = fitted.tracks.uv.astype(np.float64), fitted.tracks.t
    along, across = [], []
    for i in inner:
        R, T = motion.pose(float(t[i]))
        X = corners @ R.T + T
        at = camera.project(X[X[:, 2] > 0.1])
        gap = uv[i] - at
        near = np.linalg.norm(gap, axis=1) < 6
        if near.sum() == 1:
            way = uv[i + 1] - uv[i - 1]
            way = way / np.linalg.norm(way)
            along.append(gap[near][0] @ way)
            across.append(gap[near][0] @ [-way[1], way[0]])
    if not along:
        return "none alone"
    return (
        f"along {np.median(along):+.2f} (std {np.std(along):.2f}), "
        f"across {np.median(across):+.2f} (std {np.std(across):.2f}) px"
    )
