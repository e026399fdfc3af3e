"""Errors of estimates, and of their standard deviations, on recordings with known truth (paper, section 6)."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from esfo_backend.backend import Backend
from esfo_backend.options import BackendOptions
from esfo_backend.orbit.observations import observations
from esfo_backend.orbit.parametrization import spin_and_points
from esfo_bringup.errors import CommandError
from esfo_bringup.offline.source import open_source
from esfo_bringup.settings import RunSettings
from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.estimate import OrbitEstimate
from esfo_core.evaluation.orbit_error import compare, spin_of
from esfo_core.evaluation.registration import MeshSurface, RegistrationError, register
from esfo_core.events import EventArray
from esfo_core.orbit import Matrix, Spin, tangent_basis
from esfo_core.recordings import Recording
from esfo_core.tracks import Tracks, TrackUpdate
from esfo_frontend.frontend import Frontend
from esfo_frontend.options import FrontendOptions

_NOWHERE = (np.nan, np.nan)
_TRUTH = ".truth.json"


@dataclass(frozen=True)
class TrueScene:
    """A recording with its camera, its true motion (metres) and its true surface, None where it is not known."""

    name: str
    recording: Recording
    camera: Camera
    spin: Spin
    surface: MeshSurface | None


@dataclass(frozen=True)
class TrackedScene:
    """Output of the front-end on a recording, and the CPU seconds that it took."""

    tracks: Tracks
    activity: Activity
    seconds: float


@dataclass(frozen=True)
class OrbitResult:
    """One scene under one preset; NaN stands for what could not be measured.

    z_rate: error over its stated standard deviation. z_axis: Mahalanobis distance of the axis (two dimensions). colmap:
    registered views of all views, and reprojection error; `*` where its initialisation was used. before, after: mean
    and median distance from the true surface in % of its diameter, after initialisation and at the end. seconds:
    front-end (CPU), back-end (wall).
    """

    scene: str
    preset: str
    estimate: OrbitEstimate
    rate_percent: float
    axis_deg: float
    screw_px: float
    z_rate: float
    z_axis: float
    colmap: str
    before: tuple[float, float]
    after: tuple[float, float]
    seconds: tuple[float, float]

    def to_json(self) -> dict[str, Any]:
        """Return the values of the row by name; None stands for NaN."""
        e = self.estimate
        numbers = {
            "rate_error_percent": self.rate_percent,
            "axis_error_deg": self.axis_deg,
            "screw_line_error_px": self.screw_px,
            "rate_error_over_std": self.z_rate,
            "axis_error_over_std": self.z_axis,
            "rms_reprojection_px": e.rms_px,
            "registration_at_start_percent": self.before[0],
            "registration_percent": self.after[0],
            "frontend_cpu_s": self.seconds[0],
            "backend_s": self.seconds[1],
        }
        return {
            "scene": self.scene,
            "preset": self.preset,
            "status": e.status,
            "flags": list(e.flags),
            "reason": e.reason,
            "points": len(e.points),
            "colmap": self.colmap,
            **{name: float(value) if np.isfinite(value) else None for name, value in numbers.items()},
        }


def find_scenes(folder: Path) -> list[Path]:
    """Return the recordings below `folder` that have a `.truth.json` beside them, as `esfo simulate` writes them.

    Raises CommandError where there is none, or where the recording of a truth is missing.
    """
    truths = sorted(folder.rglob(f"*{_TRUTH}"))
    if not truths:
        raise CommandError(f"{folder}: no recording with a {_TRUTH} beside it (esfo simulate writes them)")
    recordings = [path.with_name(path.name.removesuffix(_TRUTH) + ".mcap") for path in truths]
    for path in recordings:
        if not path.is_file():
            raise CommandError(f"{path}: no such recording, although its truth is there")
    return recordings


def open_scene(path: Path) -> TrueScene:
    """Open a recording, its `.truth.json` and its `.ply`; without a mesh there is no registration.

    Raises CommandError for a malformed truth, EvaluationError for one without a spin, and RecordingError.
    """
    truth_path = path.with_suffix(_TRUTH)
    try:
        truth = json.loads(truth_path.read_text())
        t0 = int(truth["t0_ns"])
    except (ValueError, KeyError, TypeError) as error:
        raise CommandError(f"{truth_path}: not the truth of a scene ({error!r})") from error
    spin = spin_of(truth, str(truth_path))
    model = path.with_suffix(".ply")
    source = open_source(path, None)
    surface = MeshSurface(trimesh.load_mesh(model)) if model.is_file() else None
    return TrueScene(
        path.stem, source.recording, source.camera, Spin(spin.axis, spin.rate_hz, spin.center, t0), surface
    )


def track(chunks: Iterable[EventArray], camera: Camera, options: FrontendOptions | None = None) -> TrackedScene:
    """Run the front-end over events. Raises CommandError where there are none."""
    frontend = Frontend(camera, options)
    begin = time.process_time()
    outputs = [output for _, output in frontend.run(chunks)]
    seconds = time.process_time() - begin
    activity = [output.activity for output in outputs if output.activity is not None]
    if not activity:
        raise CommandError("no events")
    return TrackedScene(
        Tracks.concatenate(output.tracks.observations for output in outputs), Activity.concatenate(activity), seconds
    )


def backend_of(tracked: TrackedScene, camera: Camera, options: BackendOptions | None = None) -> Backend:
    """Return a back-end that has received all tracks and all activity."""
    backend = Backend(camera, options)
    backend.add(TrackUpdate(tracked.tracks, np.empty(0, np.uint32)), tracked.activity)
    return backend


def measure_orbit(scene: TrueScene, preset: str, settings: RunSettings, tracked: TrackedScene) -> OrbitResult:
    """Solve, and compare the estimate with the truth. preset: name of the preset in the result."""
    backend = backend_of(tracked, scene.camera, settings.backend)
    begin = time.perf_counter()
    estimate = backend.solve()
    seconds = (tracked.seconds, time.perf_counter() - begin)
    before, colmap = _initial(backend, tracked, scene)
    if estimate.spin is None:
        nan = np.nan
        return OrbitResult(scene.name, preset, estimate, nan, nan, nan, nan, nan, colmap, before, _NOWHERE, seconds)
    true = scene.spin
    truth = {"spin_rate_hz": true.rate_hz, "axis": true.axis, "center": true.center}
    found = compare(estimate.to_json({}), truth, scene.camera)
    off = tangent_basis(estimate.spin.axis).T @ true.axis
    return OrbitResult(
        scene.name,
        preset,
        estimate,
        100 * found.rate_error,
        found.axis_error_deg,
        np.nan if found.screw_line_error_px is None else found.screw_line_error_px,
        abs(estimate.spin.rate_hz - true.rate_hz) / estimate.rate_std_hz,
        float(np.sqrt(off @ np.linalg.solve(estimate.axis_cov, off))),
        colmap,
        before,
        _registered(estimate.spin, estimate.points, scene),
        seconds,
    )


def _initial(backend: Backend, tracked: TrackedScene, scene: TrueScene) -> tuple[tuple[float, float], str]:
    """Return the registration of the initial points, and the result of COLMAP."""
    start = None if backend.last_search is None else backend.last_search.initialisation
    if start is None:
        return _NOWHERE, "none"
    obs, _ = observations(tracked.tracks, scene.camera, backend.options.initialisation.min_observations)
    spin, points = spin_and_points(start.solution.motion, start.solution.y, obs.t_ref, scene.spin.t0)
    model = start.colmap
    taken = "*" * (start.name == "colmap")
    colmap = "none" if model is None else f"{model.registered}/{model.views}, {model.rms_px:.2f}{taken}"
    return _registered(spin, points, scene), colmap


def _registered(spin: Spin, points: Matrix, scene: TrueScene) -> tuple[float, float]:
    if scene.surface is None:
        return _NOWHERE
    try:
        found = register(points[np.isfinite(points).all(axis=1)], spin, scene.surface, scene.spin)
    except RegistrationError:
        return _NOWHERE
    return found.mean_percent, found.median_percent
