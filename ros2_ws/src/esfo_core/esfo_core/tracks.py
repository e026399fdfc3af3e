"""Feature tracks, from which the back-end estimates the structure."""

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

    Raises TracksError for columns of unequal length, non-finite positions or a sigma that is not above 0 and finite.
    """

    track_id: NDArray[np.uint32]
    t: NDArray[np.int64]
    uv: NDArray[np.float32]
    sigma: NDArray[np.float32]

    def __post_init__(self) -> None:
        n = len(self.track_id)
        if self.track_id.shape != (n,) or self.t.shape != (n,) or self.uv.shape != (n, 2) or self.sigma.shape != (n,):
            raise TracksError(
                f"columns of unequal length: track_id {self.track_id.shape}, t {self.t.shape}, uv {self.uv.shape}, "
                f"sigma {self.sigma.shape}"
            )
        if not np.isfinite(self.uv).all():
            raise TracksError(f"row {int(np.argmin(np.isfinite(self.uv).all(axis=1)))} has a non-finite position")
        usable = (self.sigma > 0) & np.isfinite(self.sigma)
        if not usable.all():
            row = int(np.argmin(usable))
            raise TracksError(f"row {row} has sigma {self.sigma[row]}, which is not a positive number")

    def __len__(self) -> int:
        return len(self.track_id)

    @staticmethod
    def empty() -> Tracks:
        """Return tracks without a row."""
        return Tracks.from_columns([], [], np.empty((0, 2)), [])

    @staticmethod
    def from_columns(track_id: object, t: object, uv: object, sigma: object) -> Tracks:
        """Build from anything array-like, converting to the stored types.

        Raises TracksError for what the types cannot hold, besides the errors of the class.
        """
        ids = np.asarray(track_id)
        if ids.size and not (ids.min() >= 0 and ids.max() <= np.iinfo(np.uint32).max):
            raise TracksError(f"track ids {ids.min()} to {ids.max()} are not all of 32 bits")
        try:
            with np.errstate(over="ignore"):  # beyond float32 becomes infinite, which the class refuses
                return Tracks(
                    np.ascontiguousarray(ids, np.uint32),
                    np.ascontiguousarray(t, np.int64),
                    np.ascontiguousarray(uv, np.float32).reshape(-1, 2),
                    np.ascontiguousarray(sigma, np.float32),
                )
        except OverflowError as error:
            raise TracksError(f"a time is not of 64 bits ({error})") from error

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
        """Return the rows ordered by track, then time: the table does not depend on the order of arrival."""
        return self.select(np.lexsort((self.sigma, self.uv[:, 1], self.uv[:, 0], self.t, self.track_id)))

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
                    raise TracksError(f"{path}: header is {','.join(header)[:80]!r}, expected {','.join(_COLUMNS)!r}")
                rows = [_row(path, reader.line_num, texts) for texts in reader]
        except OSError as error:
            raise TracksError(f"{path}: {error.strerror}") from error
        except (UnicodeDecodeError, csv.Error) as error:
            raise TracksError(f"{path}: not a CSV file ({error})") from error
        track_id, t, uv, sigma = zip(*rows, strict=True) if rows else ((), (), np.empty((0, 2)), ())
        try:
            return Tracks.from_columns(track_id, t, uv, sigma)
        except TracksError as error:
            raise TracksError(f"{path}: {error}") from error


def _row(path: Path, line: int, texts: list[str]) -> tuple[int, int, tuple[float, float], float]:
    try:
        track_id, t, u, v, sigma = texts
        return int(track_id), int(t), (float(u), float(v)), float(sigma)
    except ValueError as error:
        raise TracksError(f"{path}: line {line} is not five numbers: {','.join(texts)[:80]!r}") from error


@dataclass(frozen=True)
class TrackUpdate:
    """Changes of the tracks since the last update.

    observations: new rows of living tracks; ended: (K,) uint32 ids that will get no further row.
    """

    observations: Tracks
    ended: NDArray[np.uint32]
