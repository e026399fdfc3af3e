"""The files of a result: orbit.json, points.ply, tracks.csv, axis.png, checks.png and report.html."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from esfo_bringup.offline.pipeline import RunResult
from esfo_bringup.offline.source import Source
from esfo_bringup.results.event_image import EventImage
from esfo_bringup.results.figures import draw_checks, draw_events
from esfo_bringup.results.rate_over_time import rate_over_time
from esfo_bringup.results.report import write_report
from esfo_core.activity import Activity
from esfo_core.result_files import versions, whole_file, write_result_files

_DPI = 100


def write_results(
    result: RunResult, source: Source, event_image: EventImage, activity: Sequence[Activity], folder: Path
) -> None:
    """Write all files but result.mcap into `folder`, which is created; points.ply only where there are points.

    event_image, activity: of the events of the source.

    Raises EsfoError when a file cannot be written; no half file stays.
    """
    estimate = result.estimate
    write_result_files(folder, estimate, result.tracks)
    with whole_file(folder / "axis.png") as path:
        draw_events(estimate, estimate.camera(source.camera), event_image).savefig(path, dpi=_DPI)
    checks = folder / "checks.png"
    checks.unlink(missing_ok=True)
    if estimate.spin is not None:
        rates = rate_over_time(Activity.concatenate(activity), estimate.spin.rate_hz)
        with whole_file(checks) as path:
            draw_checks(estimate, rates).savefig(path, dpi=_DPI)
    with whole_file(folder / "report.html"):
        write_report(result, source, versions(), folder)
