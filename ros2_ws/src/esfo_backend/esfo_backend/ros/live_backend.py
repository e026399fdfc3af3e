"""The back-end on live topics: it waits for the camera and restarts when time goes back."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from esfo_backend.backend import Backend
from esfo_backend.errors import BackendError
from esfo_backend.options import BackendOptions
from esfo_core.activity import Activity
from esfo_core.activity_pyramid import BINS as PYRAMID_BINS
from esfo_core.camera import Camera
from esfo_core.errors import CameraError, EsfoError
from esfo_core.estimate import OrbitEstimate
from esfo_core.options import option
from esfo_core.result_files import write_result_files
from esfo_core.tracks import Tracks, TrackUpdate

RESTART_NS = 1_000_000_000
"""Activity that goes back by more than this is a new stream (a bag that loops)."""

_NO_TRACKS = TrackUpdate(Tracks.empty(), np.empty(0, np.uint32))

MAX_WAITING = 20_000
"""Messages kept while the camera is unknown."""


@dataclass(frozen=True)
class BackendNodeOptions:
    """Options of the node."""

    object_frame: str = option("object", "frame_id of the object")
    idle_solve_s: float = option(
        1.0, "wall time without new data after which all data are solved again, s; 0: never", 0.0
    )
    save_folder: str = option("~/.ros/esfo", "folder in which `~/save` creates a subfolder named by date and time")
    resume: str = option("", "state.npz of an earlier `~/save`, loaded when the node is configured; empty: none")


class LiveBackend:
    """Passes received messages to a back-end, in their order.

    observations, activity_bins: received since the start. dropped: messages dropped while the camera was unknown.
    restarts: how often time went back.
    """

    def __init__(self, options: BackendOptions) -> None:
        self.observations = self.activity_bins = self.dropped = self.restarts = 0
        self.camera: Camera | None = None
        self._options = options
        self._backend: Backend | None = None
        self._waiting: deque[tuple[TrackUpdate, Activity | None, tuple[Activity, ...]]] = deque()
        self._activity_end: int | None = None
        self._latest: OrbitEstimate | None = None

    def configure(self, options: BackendOptions) -> None:
        """Use other options and keep the received data; the next estimate is a search."""
        self._options = options
        if self._backend is not None:
            self._backend = self._backend.with_options(options)

    def reset(self) -> None:
        """Drop everything but the camera."""
        self._waiting.clear()
        self._activity_end = self._latest = None
        self._backend = None if self.camera is None else Backend(self.camera, self._options)

    def resume(self, path: Path) -> None:
        """Continue from a saved state. Raises StateError for another file or another version."""
        self._backend = Backend.load(path, self._options)
        self.camera = self._backend.camera

    def save(self, folder: Path) -> None:
        """Write the latest estimate, its tracks and the state into `folder`, which is created.

        Raises EsfoError when there is no estimate yet or the files cannot be written.
        """
        if self._backend is None or self._latest is None:
            raise BackendError("there is no estimate to save yet")
        write_result_files(folder, self._latest, self._backend.tracks())
        self._backend.save(folder / "state.npz")

    def set_camera(self, camera: Camera) -> None:
        """Restart with this camera, unless it is unchanged; add the data received before it."""
        if self.camera is not None and _same(self.camera, camera):
            return
        self.camera, self._backend = camera, Backend(camera, self._options)
        while self._waiting:
            self._backend.add(*self._waiting.popleft())

    def add_tracks(self, update: TrackUpdate) -> None:
        """Add tracks."""
        self.observations += len(update.observations)
        self._add(update, None)

    def add_activity(self, activity: Activity) -> None:
        """Add activity. Raises CameraError when its grid does not fit the size of the camera."""
        if activity.bin in PYRAMID_BINS:
            self.activity_bins += len(activity.counts)
            self._add(_NO_TRACKS, None, (activity,))
            return
        if self._activity_end is not None and activity.t0 < self._activity_end - RESTART_NS:
            self.restarts += 1
            self.reset()
        self._activity_end = activity.end
        self.activity_bins += len(activity.counts)
        self._check_grid(activity)
        self._add(_NO_TRACKS, activity)

    def due(self) -> bool:
        """Return whether there are enough new data for another estimate."""
        return self._backend is not None and self._backend.due()

    def solve(self, thorough: bool = True) -> OrbitEstimate:
        """Estimate from everything received; takes seconds. thorough: as in `Backend.solve`."""
        backend = self._backend
        if backend is None:
            return OrbitEstimate.failure("no camera_info received", observations=self.observations)
        try:
            self._latest = backend.solve(thorough)
        except EsfoError as error:
            self._latest = OrbitEstimate.failure(str(error), observations=self.observations)
        return self._latest

    def _add(self, update: TrackUpdate, activity: Activity | None, pyramid: tuple[Activity, ...] = ()) -> None:
        if self._backend is not None:
            self._backend.add(update, activity, pyramid)
            return
        if len(self._waiting) >= MAX_WAITING:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append((update, activity, pyramid))

    def _check_grid(self, activity: Activity) -> None:
        rows, columns = activity.counts.shape[2:]
        camera, cell = self.camera, activity.cell
        if camera is not None and (rows, columns) != (-(-camera.height // cell), -(-camera.width // cell)):
            raise CameraError(
                f"camera_info is of {camera.width}x{camera.height} px, the events of a sensor of {columns}x{rows} "
                f"cells of {cell} px"
            )


def verdict_values(estimate: OrbitEstimate | None) -> dict[str, object]:
    """Return the diagnostic values of the latest estimate."""
    if estimate is None:
        return {"status": "no estimate yet"}
    return {
        "status": estimate.status,
        "reason": estimate.reason,
        "flags": ", ".join(estimate.flags),
        "reprojection px": round(estimate.rms_px, 3),
        "points": len(estimate.points),
        "ambiguity": "; ".join(f"{a.kind} {a.rate_hz:.4f} Hz x{a.score_ratio:.2f}" for a in estimate.alternatives),
    }


def _same(a: Camera, b: Camera) -> bool:
    return (a.width, a.height, a.distortion_model) == (b.width, b.height, b.distortion_model) and (
        np.array_equal(a.K, b.K) and np.array_equal(a.D, b.D)
    )
