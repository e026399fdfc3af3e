"""Observations of landmarks, in the form that the kernels read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from esfo_backend.errors import BackendError
from esfo_core.camera import Camera
from esfo_core.events import NS_PER_S
from esfo_core.orbit import Matrix, Vector
from esfo_core.tracks import Tracks

REFERENCE_SIGMA_PX = 0.5
"""Standard deviation that is not in the sigma of a track: the corner is not exactly a point of the object."""


class ObservationRows(NamedTuple):
    """Observations sorted by landmark, in the form that the kernels read.

    dt: (N,) s from the reference time. xy: (N, 2) ideal plane coordinates. weight: (N,) in (0, 1], relative to an
    observation with sigma 0. first: (P + 1,) observations of landmark j are first[j]:first[j+1]. focal: (2,) px.
    """

    dt: Vector
    xy: Matrix
    weight: Vector
    first: NDArray[np.int64]
    focal: Vector


@dataclass(frozen=True)
class Observations:
    """Observations and the reference time t_ref in ns of their times."""

    rows: ObservationRows
    t_ref: int

    @property
    def points(self) -> int:
        """Number of landmarks."""
        return len(self.rows.first) - 1

    def of_point(self, j: int) -> ObservationRows:
        """Observations of landmark j."""
        dt, xy, weight, first, focal = self.rows
        part = slice(first[j], first[j + 1])
        return ObservationRows(dt[part], xy[part], weight[part], np.array([0, first[j + 1] - first[j]]), focal)

    def point_index(self) -> NDArray[np.int64]:
        """Landmark index of each observation, (N,)."""
        return np.repeat(np.arange(self.points), np.diff(self.rows.first))

    def part(self, chosen: NDArray[np.bool_], min_observations: int) -> Observations:
        """Keep the observations chosen by a mask (N,), of landmarks that have at least `min_observations` of them."""
        point = self.point_index()
        enough = np.bincount(point[chosen], minlength=self.points) >= min_observations
        k = np.flatnonzero(chosen & enough[point])
        dt, xy, weight, _, focal = self.rows
        counts = np.bincount(point[k], minlength=self.points)
        first = np.concatenate([[0], np.cumsum(counts[counts > 0])])
        return Observations(ObservationRows(dt[k], xy[k], weight[k], first, focal), self.t_ref)

    def regroup(self, label: NDArray[np.int64]) -> Observations:
        """Merge landmarks: landmark j becomes part of landmark label[j]; a negative label drops it."""
        row_label = label[self.point_index()]
        k = np.flatnonzero(row_label >= 0)
        k = k[np.lexsort((self.rows.dt[k], row_label[k]))]
        counts = np.bincount(row_label[k], minlength=int(label.max(initial=-1)) + 1)
        first = np.concatenate([[0], np.cumsum(counts[counts > 0])])
        dt, xy, weight, _, focal = self.rows
        return Observations(ObservationRows(dt[k], xy[k], weight[k], first, focal), self.t_ref)


def observations(tracks: Tracks, camera: Camera, min_observations: int) -> tuple[Observations, NDArray[np.uint32]]:
    """Return the tracks of at least `min_observations` rows, a landmark each, and their track ids, (P,).

    Raises BackendError when no track is long enough.
    """
    ordered = tracks.sorted()
    ids, counts = np.unique(ordered.track_id, return_counts=True)
    long_enough = np.repeat(counts >= min_observations, counts)
    if not long_enough.any():
        raise BackendError(f"none of {len(ids)} tracks has {min_observations} observations", "too_few_points")
    kept = ordered.select(long_enough)
    counts = counts[counts >= min_observations]
    t_ref = int(kept.t.min() + (kept.t.max() - kept.t.min()) // 2)
    rows = ObservationRows(
        (kept.t - t_ref) / NS_PER_S,
        camera.unproject(kept.uv),
        REFERENCE_SIGMA_PX / np.sqrt(REFERENCE_SIGMA_PX**2 + kept.sigma.astype(np.float64) ** 2),
        np.concatenate([[0], np.cumsum(counts)]),
        np.array([camera.K[0, 0], camera.K[1, 1]]),
    )
    return Observations(rows, t_ref), np.unique(kept.track_id)
