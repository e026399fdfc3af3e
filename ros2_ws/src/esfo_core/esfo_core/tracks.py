"""Feature tracks: the only thing that the back-end learns about the shape of the object."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from esfo_core.errors import TracksError

_COLUMNS = ("track_id", "t", "u", "v", "sigma")


@dataclass(frozen=True)
class Tracks:
    """Observations of tracked features, one row each, in columns.

    track_id: (N,) uint32; rows of one feature share it.
    t: (N,) int64, sensor time in nanoseconds, the mean time of the events behind the row.
    uv: (N, 2) float32, pixel position (column, row), pixel centres at integers.
    sigma: (N,) float32, standard deviation of each coordinate in pixels.

    Raises TracksError for columns of unequal length, non-finite positions or sigma <= 0.
    """

    track_id: NDArray[np.uint32]
    t: NDArray[np.int64]
    uv: NDArray[np.float32]
    sigma: NDArray[np.float32]

    def __post_init__(self) -> None:
        n = len(self.track_id)
        if self.t.shape != (n,) or self.uv.shape != (n, 2) or self.sigma.shape != (n,):
            raise TracksError(
                f"columns of unequal length: track_id {n}, t {self.t.shape}, uv {self.uv.shape}, "
                f"sigma {self.sigma.shape}"
            )
        if not np.isfinite(self.uv).all():
            raise TracksError(f"row {int(np.argmin(np.isfinite(self.uv).all(axis=1)))} has a non-finite position")
        if not (self.sigma > 0).all():
            row = int(np.argmin(self.sigma > 0))
            raise TracksError(f"row {row} has sigma {self.sigma[row]}, which is not positive")

    def __len__(self) -> int:
        return len(self.track_id)

    @staticmethod
    def empty() -> Tracks:
        """Return tracks without a row."""
        return Tracks.from_columns([], [], np.empty((0, 2)), [])

    @staticmethod
    def from_columns(track_id: object, t: object, uv: object, sigma: object) -> Tracks:
        """Build from anything array-like, converting to the stored types."""
        return Tracks(
            np.ascontiguousarray(track_id, np.uint32),
            np.ascontiguousarray(t, np.int64),
            np.ascontiguousarray(uv, np.float32).reshape(-1, 2),
            np.ascontiguousarray(sigma, np.float32),
        )

    @staticmethod
    def concatenate(parts: Iterable[Tracks]) -> Tracks:
        """Stack the rows of several tables in the order given."""
        tables = list(parts)
        if not tables:
            return Tracks.empty()
        return Tracks(
            np.concatenate([p.track_id for p in tables]),
            np.concatenate([p.t for p in tables]),
            np.concatenate([p.uv for p in tables]),
            np.concatenate([p.sigma for p in tables]),
        )

    def select(self, rows: NDArray[np.generic]) -> Tracks:
        """Return the rows given by a mask or an index array."""
        return Tracks(self.track_id[rows], self.t[rows], self.uv[rows], self.sigma[rows])

    def sorted(self) -> Tracks:
        """Return the rows ordered by track, then time: the same table whatever order rows arrived in."""
        return self.select(np.lexsort((self.uv[:, 1], self.uv[:, 0], self.t, self.track_id)))

    def write_csv(self, path: Path) -> None:
        """Write a header line and one line per row; positions with the digits that float32 needs."""
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(_COLUMNS)
            for i in range(len(self)):
                u, v = self.uv[i]
                writer.writerow((int(self.track_id[i]), int(self.t[i]), str(u), str(v), str(self.sigma[i])))

    @staticmethod
    def read_csv(path: Path) -> Tracks:
        """Read what `write_csv` wrote. Raises TracksError for a missing or malformed file."""
        try:
            with path.open(newline="") as file:
                reader = csv.reader(file)
                header = next(reader, [])
                if tuple(header) != _COLUMNS:
                    raise TracksError(f"{path}: header is {header}, expected {list(_COLUMNS)}")
                rows = list(reader)
        except OSError as error:
            raise TracksError(f"{path}: {error.strerror}") from error
        try:
            return Tracks.from_columns(
                [int(r[0]) for r in rows],
                [int(r[1]) for r in rows],
                np.array([(float(r[2]), float(r[3])) for r in rows]).reshape(-1, 2),
                [float(r[4]) for r in rows],
            )
        except (ValueError, IndexError) as error:
            raise TracksError(f"{path}: {error}") from error


@dataclass(frozen=True)
class TrackUpdate:
    """What the front-end learnt since its last update.

    observations: new rows of living tracks; ended: (K,) uint32 ids that will get no further row.
    """

    observations: Tracks
    ended: NDArray[np.uint32]
