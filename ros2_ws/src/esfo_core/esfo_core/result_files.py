"""The files of a result, as the command and the back-end node write them: orbit.json, points.ply and tracks.csv."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import metadata
from pathlib import Path
from platform import python_version

from esfo_core import __version__
from esfo_core.errors import EsfoError
from esfo_core.estimate import OrbitEstimate
from esfo_core.point_cloud import write_points
from esfo_core.tracks import Tracks

_LIBRARIES = ("numpy", "numba", "hdbscan", "gtsam", "pycolmap")


def versions() -> dict[str, str]:
    """Versions of all packages that may change a number in the result."""
    return {"esfo": __version__, "python": python_version(), **{name: metadata.version(name) for name in _LIBRARIES}}


def write_result_files(folder: Path, estimate: OrbitEstimate, tracks: Tracks) -> None:
    """Write all files into `folder`, which is created; points.ply only where there are points.

    Raises EsfoError when that cannot be done.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        points = folder / "points.ply"
        points.unlink(missing_ok=True)
    except OSError as error:
        raise EsfoError(f"{error.filename or folder}: {error.strerror}") from error
    with whole_file(folder / "orbit.json") as path:
        estimate.write_json(path, versions())
    with whole_file(folder / "tracks.csv") as path:
        tracks.write_csv(path)
    if len(estimate.points):
        with whole_file(points):
            write_points(points, estimate.points)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Remove a file that could not be written to its end, and raise EsfoError with its path."""
    try:
        yield path
    except OSError as error:
        if path.is_file():
            with suppress(OSError):
                path.unlink()
        raise EsfoError(f"{path}: {error.strerror or error}") from error
