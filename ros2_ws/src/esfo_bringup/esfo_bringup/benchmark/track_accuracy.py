"""Number, age and accuracy of feature tracks on folders of the Event Camera Dataset.

The protocol of the paper's front-end evaluation (section 6.1): every track of at least 4 rows is compared with its
point, triangulated with the true poses; it counts where its root mean square error is within a threshold.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from esfo_bringup.errors import CommandError
from esfo_bringup.progress import follow
from esfo_core.camera import Camera
from esfo_core.evaluation.track_error import SHORTEST, fit_tracks
from esfo_core.events import NS_PER_S
from esfo_core.recordings import ReadingOptions, open_recording
from esfo_core.recordings.event_camera_dataset import SENSOR, read_calib, read_groundtruth
from esfo_core.tracks import Tracks
from esfo_frontend.frontend import Frontend
from esfo_frontend.options import FrontendOptions
from esfo_frontend.trackers import Statistics

THRESHOLDS_PX = (3.0, 5.0, 7.0)
"""Thresholds of the paper."""

_EVENTS, _POSES, _CALIBRATION = "events.txt", "groundtruth.txt", "calib.txt"


@dataclass(frozen=True)
class Accuracy:
    """Of the tracks whose root mean square error is at most threshold_px: their number, mean of the error and age."""

    threshold_px: float
    tracks: int
    rmse_px: float
    age_s: float


@dataclass(frozen=True)
class TrackResult:
    """One folder under one preset.

    age_s: (K,) from first to last row of every track of at least 4 rows. accuracies: at THRESHOLDS_PX; empty without
    true poses. outside: rows outside the time of the poses, left out. seconds: CPU time without reading.
    """

    scene: str
    preset: str
    statistics: Statistics
    duration_s: float
    age_s: NDArray[np.float64]
    accuracies: tuple[Accuracy, ...]
    outside: int
    seconds: float

    def to_json(self) -> dict[str, Any]:
        """Return the values of the row by name; None stands for NaN."""
        return {
            "scene": self.scene,
            "preset": self.preset,
            "events": self.statistics.events,
            "duration_s": self.duration_s,
            "corners": self.statistics.corners,
            "corners_per_s": self.statistics.corners / self.duration_s if self.duration_s else None,
            "tracks": len(self.age_s),
            "mean_age_s": _mean(self.age_s),
            "median_age_s": float(np.median(self.age_s)) if len(self.age_s) else None,
            "rows_without_pose": self.outside,
            "accuracy": [
                {
                    "threshold_px": a.threshold_px,
                    "tracks": a.tracks,
                    "rmse_px": a.rmse_px if a.tracks else None,
                    "mean_age_s": a.age_s if a.tracks else None,
                }
                for a in self.accuracies
            ],
            "frontend_cpu_s": self.seconds,
        }


def find_recordings(folder: Path) -> list[Path]:
    """Return `folder` and the folders below it that have an `events.txt`. Raises CommandError where there is none."""
    found = sorted(path.parent for path in folder.rglob(_EVENTS))
    if not found:
        raise CommandError(f"{folder}: no folder of the Event Camera Dataset (none has an {_EVENTS})")
    return found


def measure_tracks(folder: Path, preset: str, options: FrontendOptions) -> TrackResult:
    """Run the front-end over a folder; compare its tracks with `groundtruth.txt` where there is one.

    Raises RecordingError and CameraError for files that are not in the form of the dataset.
    """
    recording = open_recording(folder / _EVENTS, None, ReadingOptions(width=SENSOR[0], height=SENSOR[1]))
    frontend = Frontend(recording, options)
    parts, seconds, begin, end = [], 0.0, None, 0
    for events in follow(recording, recording.chunks(), folder.name):
        begin, end = int(events["t"][0]) if begin is None else begin, int(events["t"][-1])
        started = time.process_time()
        parts.append(frontend.process(events).tracks.observations)
        seconds += time.process_time() - started
    started = time.process_time()
    parts.append(frontend.flush().tracks.observations)
    seconds += time.process_time() - started
    tracks = Tracks.concatenate(parts).sorted()
    accuracies: tuple[Accuracy, ...] = ()
    outside = 0
    if (folder / _POSES).is_file():
        accuracies, outside = _accuracies(tracks, folder, read_calib(folder / _CALIBRATION))
    return TrackResult(
        folder.name,
        preset,
        frontend.statistics,
        (end - (begin or 0)) / NS_PER_S,
        _ages(tracks),
        accuracies,
        outside,
        seconds,
    )


def _ages(tracks: Tracks) -> NDArray[np.float64]:
    _, first, count = np.unique(tracks.track_id, return_index=True, return_counts=True)
    first, count = first[count >= SHORTEST], count[count >= SHORTEST]
    return np.asarray((tracks.t[first + count - 1] - tracks.t[first]) / NS_PER_S)


def _accuracies(tracks: Tracks, folder: Path, camera: Camera) -> tuple[tuple[Accuracy, ...], int]:
    poses = read_groundtruth(folder / _POSES)
    covered = (tracks.t >= poses.t[0]) & (tracks.t <= poses.t[-1])
    fitted = fit_tracks(tracks.select(covered), camera, poses.world_to_camera)
    found = []
    for threshold in THRESHOLDS_PX:
        counts = (fitted.rms <= threshold) & fitted.front
        number = int(counts.sum())
        rmse, age = (float(v[counts].mean()) if number else np.nan for v in (fitted.rms, fitted.age))
        found.append(Accuracy(threshold, number, rmse, age))
    return tuple(found), int((~covered).sum())


def _mean(values: NDArray[np.float64]) -> float | None:
    return float(values.mean()) if len(values) else None


_LIMITS = ", ".join(f"{v:g}" for v in THRESHOLDS_PX)
HEADER = (
    "| scene | preset | events, M | s | corners, 1/s | of events, % | tracks | age, s: mean, median "
    f"| RMSE at {_LIMITS} px | mean age, s | tracks | CPU s |",
    "|---|---|---|---|---|---|---|---|---|---|---|---|",
)


def row_of(r: TrackResult) -> str:
    """Return the row of one folder; the columns that need true poses are empty without them."""
    s = r.statistics
    ages = f"{r.age_s.mean():.3f}, {np.median(r.age_s):.3f}" if len(r.age_s) else "-"
    per_s = f"{s.corners / r.duration_s:.0f}" if r.duration_s else "-"
    rmse = ", ".join(f"{a.rmse_px:.2f}" for a in r.accuracies)
    age = ", ".join(f"{a.age_s:.3f}" for a in r.accuracies)
    number = ", ".join(str(a.tracks) for a in r.accuracies)
    return (
        f"| {r.scene} | {r.preset} | {s.events / 1e6:.3f} | {r.duration_s:.2f} | {per_s} "
        f"| {100 * s.corners / max(s.events, 1):.1f} | {len(r.age_s)} | {ages} | {rmse} | {age} | {number} "
        f"| {r.seconds:.1f} |"
    )
