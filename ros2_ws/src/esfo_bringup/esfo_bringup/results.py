"""What a run leaves behind: orbit.json, points.ply, tracks.csv, axis.png, checks.png and report.html."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from platform import python_version

from esfo_bringup import __version__
from esfo_bringup.exposure import Exposure
from esfo_bringup.offline import RunResult, Source
from esfo_bringup.picture import draw_checks, draw_events
from esfo_bringup.rate_course import rate_course
from esfo_bringup.report import write_report
from esfo_core.activity import Activity
from esfo_core.point_cloud import write_points

_LIBRARIES = ("numpy", "numba", "hdbscan", "gtsam", "pycolmap")


def versions() -> dict[str, str]:
    """Versions of everything that may change a number in the result."""
    return {"esfo": __version__, "python": python_version(), **{name: metadata.version(name) for name in _LIBRARIES}}


def write_results(
    result: RunResult, source: Source, exposure: Exposure, activity: Sequence[Activity], folder: Path
) -> None:
    """Write all files but result.mcap into `folder`, which is made; points.ply only where there are points.

    exposure, activity: of the events of the source.
    """
    folder.mkdir(parents=True, exist_ok=True)
    estimate = result.estimate
    estimate.write_json(folder / "orbit.json", versions())
    result.tracks.write_csv(folder / "tracks.csv")
    points = folder / "points.ply"
    points.unlink(missing_ok=True)
    if len(estimate.points):
        write_points(points, estimate.points)
    draw_events(result, source.camera, exposure, folder / "axis.png")
    checks = folder / "checks.png"
    checks.unlink(missing_ok=True)
    if estimate.spin is not None:
        draw_checks(result, rate_course(Activity.concatenate(activity), estimate.spin.rate_hz), checks)
    write_report(result, source, versions(), folder)
