"""Errors of feature tracks: each track against the static point that fits it best, given the true poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from esfo_core.camera import Camera
from esfo_core.events import NS_PER_S
from esfo_core.orbit import Matrix
from esfo_core.tracks import Tracks

WorldToCamera = Callable[[NDArray[np.int64]], tuple[NDArray[np.float64], Matrix]]
"""R (N, 3, 3) and T (N, 3) at times (N,) in ns: the point X is at R X + T before the camera."""

SHORTEST = 4
"""Rows below which a track is not judged: the point has three unknowns, and two rows always fit one."""

GOOD_PX = 3.0
_STEPS = 8


@dataclass(frozen=True)
class FittedTracks:
    """Tracks of at least `SHORTEST` rows with their points.

    tracks: the rows (N,), by track, then time. index: (N,) number of the track of a row, 0 to K - 1. count: (K,) rows.
    offset: (N, 2) px, observed minus projected. begin, end: (K,) ns. front: (K,) the point lies before the camera in
    every row.
    """

    tracks: Tracks
    index: NDArray[np.int64]
    count: NDArray[np.int64]
    offset: NDArray[np.float64]
    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    front: NDArray[np.bool_]

    @property
    def error(self) -> NDArray[np.float64]:
        """Distance (N,) px of each row to its point."""
        return np.asarray(np.linalg.norm(self.offset, axis=1))

    @property
    def rms(self) -> NDArray[np.float64]:
        """Root mean square distance (K,) px."""
        return np.asarray(np.sqrt(np.bincount(self.index, self.error**2, len(self.count)) / self.count))

    @property
    def age(self) -> NDArray[np.float64]:
        """From first to last row (K,), s."""
        return np.asarray((self.end - self.begin) / NS_PER_S)

    @property
    def good(self) -> NDArray[np.bool_]:
        """Whether every row (K,) is within `GOOD_PX` of one fixed point before the camera."""
        worst = np.zeros(len(self.count))
        np.maximum.at(worst, self.index, self.error)
        return (worst <= GOOD_PX) & self.front

    def pull(self, chosen: NDArray[np.bool_]) -> float:
        """Root mean square of offset over stated sigma, of the tracks chosen (K,).

        The three coordinates of a point are fitted to its rows and take their share of the offsets away.
        """
        rows = chosen[self.index]
        z2 = ((self.offset[rows] / self.tracks.sigma[rows, None]) ** 2).sum()
        return float(np.sqrt(z2 / (2 * self.count[chosen] - 3).sum()))


def fit_tracks(tracks: Tracks, camera: Camera, poses: WorldToCamera) -> FittedTracks:
    """Triangulate every track with the true poses: the least squares of the reprojection errors in the plane z = 1."""
    tracks = tracks.sorted()
    ids, index, count = np.unique(tracks.track_id, return_inverse=True, return_counts=True)
    tracks = tracks.select(count[index] >= SHORTEST)
    ids, first, index, count = np.unique(tracks.track_id, return_index=True, return_inverse=True, return_counts=True)
    R, T = poses(tracks.t)
    ray = camera.unproject(tracks.uv.astype(np.float64))
    point = _linear_points(ray, R, T, index, len(ids))
    for _ in range(_STEPS):
        point = _step(point, ray, (R, T), index)
    X = np.einsum("nij,nj->ni", R, point[index]) + T
    before = X[:, 2] > 1e-3
    uv = camera.project(np.where(before[:, None], X, [0.0, 0.0, 1.0]))
    offset = np.where(before[:, None], tracks.uv - uv, 1e3)
    front = np.bincount(index, ~before, len(ids)) == 0
    return FittedTracks(tracks, index, count, offset, tracks.t[first], tracks.t[first + count - 1], front)


def _solve(
    A: NDArray[np.float64], b: NDArray[np.float64], index: NDArray[np.int64], number: int
) -> NDArray[np.float64]:
    """Least squares of A_n x_k = b_n, A (N, 2, 3), b (N, 2), for each of the K = `number` groups: (K, 3)."""
    H, g = np.zeros((number, 3, 3)), np.zeros((number, 3))
    np.add.at(H, index, np.einsum("nai,naj->nij", A, A))
    np.add.at(g, index, np.einsum("nai,na->ni", A, b))
    # A little damping relative to the trace: a track without parallax leaves the depth open.
    H += 1e-9 * np.trace(H, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 1e-300 * np.eye(3)
    return np.asarray(np.linalg.solve(H, g[..., None])[..., 0])


def _linear_points(
    ray: NDArray[np.float64], R: NDArray[np.float64], T: NDArray[np.float64], index: NDArray[np.int64], number: int
) -> NDArray[np.float64]:
    """Points (K, 3) by the linear method: x z - X = 0 in both coordinates."""
    A = ray[:, :, None] * R[:, None, 2] - R[:, :2]
    b = T[:, :2] - ray * T[:, 2:]
    return _solve(A, b, index, number)


def _step(
    point: NDArray[np.float64],
    ray: NDArray[np.float64],
    pose: tuple[NDArray[np.float64], NDArray[np.float64]],
    index: NDArray[np.int64],
) -> NDArray[np.float64]:
    """One Gauss-Newton step of the reprojection errors in the plane z = 1."""
    R, T = pose
    X = np.einsum("nij,nj->ni", R, point[index]) + T
    z = np.maximum(X[:, 2], 1e-3)
    xy = X[:, :2] / z[:, None]
    J = (R[:, :2] - xy[:, :, None] * R[:, None, 2]) / z[:, None, None]
    return point + _solve(J, ray - xy, index, len(point))
