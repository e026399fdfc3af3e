"""Accuracy and honesty of the back-end over simulated twins of the paper's scenes: prints the tables of the docs."""

from __future__ import annotations

import argparse
import contextlib
import json
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from esfo_backend.backend import Backend
from esfo_backend.options import PRESETS as BACKEND_PRESETS
from esfo_backend.problem import observations, spin_and_points
from esfo_bringup.offline import open_source
from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.estimate import OrbitEstimate
from esfo_core.evaluation import compare
from esfo_core.orbit import Spin, tangent_basis
from esfo_core.recordings import open_recording
from esfo_core.registration import RegistrationError, Surface, register
from esfo_core.simulation.objects.catalogue import OBJECTS
from esfo_core.simulation.scene import SPEEDS_HZ, VIEWS, SceneOptions
from esfo_core.simulation.scene_files import is_written, topspin, write_scene
from esfo_core.tracks import Tracks, TrackUpdate
from esfo_frontend.frontend import Frontend
from esfo_frontend.options import PRESETS as FRONTEND_PRESETS

NAMES = tuple(topspin(SceneOptions()))
SUBSET = tuple(
    NAMES[(o * len(VIEWS) + (o + s) % len(VIEWS)) * len(SPEEDS_HZ) + s]
    for o in range(len(OBJECTS))
    for s in range(len(SPEEDS_HZ))
)
"""18 of the 72: every object at every speed, the views in turn."""


@dataclass(frozen=True)
class Result:
    """One scene under one preset; what could not be measured is NaN.

    z_rate, z_axis: error over its stated standard deviation; of the axis the Mahalanobis distance (two dimensions).
    before, after: mean and median distance from the true mesh in % of its diameter, at the start and at the end.
    seconds: front-end, back-end.
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


@dataclass(frozen=True)
class TrackedScene:
    """What the front-end makes of a scene, and the CPU seconds that it takes."""

    tracks: Tracks
    activity: Activity
    seconds: float

    def save(self, path: Path) -> None:
        """Write as `.npz`."""
        t, a = self.tracks, self.activity
        np.savez(
            path,
            track_id=t.track_id,
            t=t.t,
            uv=t.uv,
            sigma=t.sigma,
            counts=a.counts,
            grid=[a.t0, a.bin, a.cell],
            seconds=self.seconds,
        )

    @staticmethod
    def load(path: Path) -> TrackedScene:
        """Read what `save` wrote."""
        with np.load(path) as f:
            activity = Activity(*(int(v) for v in f["grid"]), f["counts"])
            return TrackedScene(
                Tracks.from_columns(f["track_id"], f["t"], f["uv"], f["sigma"]), activity, float(f["seconds"])
            )


def track(path: Path, camera: Camera, preset: str) -> TrackedScene:
    """Run the front-end over a recording."""
    frontend = Frontend(camera.width, camera.height, FRONTEND_PRESETS[preset])
    outputs = []
    begin = time.process_time()
    for events in open_recording(path).chunks():
        outputs.append(frontend.process(events))
    outputs.append(frontend.flush())
    seconds = time.process_time() - begin
    return TrackedScene(
        Tracks.concatenate(o.tracks.observations for o in outputs),
        Activity.concatenate(o.activity for o in outputs if o.activity is not None),
        seconds,
    )


def measure(name: str, preset: str, tracked: TrackedScene, true: Spin, camera: Camera, surface: Surface) -> Result:
    """Solve and set the result beside the truth."""
    backend = Backend(camera, BACKEND_PRESETS[preset])
    backend.add(TrackUpdate(tracked.tracks, np.empty(0, np.uint32)), tracked.activity)
    begin = time.perf_counter()
    estimate = backend.solve()
    seconds = (tracked.seconds, time.perf_counter() - begin)
    nowhere = (np.nan, np.nan)
    before, colmap = nowhere, "none"
    if backend.last_start is not None:
        start = backend.last_start
        obs, _ = observations(tracked.tracks, camera, backend.options.start.min_rows)
        before = _registered(
            *spin_and_points(start.adjusted.motion, start.adjusted.y, obs.t_ref, true.t0), surface, true
        )
        if start.colmap is not None:
            model = start.colmap
            colmap = f"{model.registered}/{model.views}, {model.rms_px:.2f}" + "*" * (start.name == "colmap")
    if estimate.spin is None:
        return Result(name, preset, estimate, *[np.nan] * 5, colmap, before, nowhere, seconds)
    truth = {"spin_rate_hz": true.rate_hz, "axis": true.axis, "center": true.center}
    found = compare(estimate.to_json({}), truth, camera)
    off = tangent_basis(estimate.spin.axis).T @ true.axis
    return Result(
        name,
        preset,
        estimate,
        100 * found.rate_error,
        found.axis_error_deg,
        np.nan if found.screw_line_error_px is None else found.screw_line_error_px,
        abs(estimate.spin.rate_hz - true.rate_hz) / estimate.rate_std_hz,
        float(np.sqrt(off @ np.linalg.solve(estimate.axis_cov, off))),
        colmap,
        before,
        _registered(estimate.spin, estimate.points, surface, true),
        seconds,
    )


def _registered(spin: Spin, points: np.ndarray, surface: Surface, true: Spin) -> tuple[float, float]:
    try:
        found = register(points[np.isfinite(points).all(axis=1)], spin, surface, true)
    except RegistrationError:
        return np.nan, np.nan
    return found.mean_percent, found.median_percent


def print_row(r: Result) -> None:
    """Print one line of the table."""
    e = r.estimate
    flags = ", ".join(f for f in e.flags if f != "scale_unobservable")
    verdict = f"{e.status} {f'[{flags}]' if flags else ''} {e.reason}".strip()
    print(
        f"| {r.scene} | {r.preset} | {verdict} | {r.rate_percent:.4f} | {r.axis_deg:.3f} | {r.screw_px:.2f} "
        f"| {r.z_rate:.1f}, {r.z_axis:.1f} | {r.colmap} | {e.rms_px:.2f} | {r.before[0]:.2f} ({r.before[1]:.2f}) "
        f"| {r.after[0]:.2f} ({r.after[1]:.2f}) | {len(e.points)} | {r.seconds[0]:.1f} + {r.seconds[1]:.1f} |",
        flush=True,
    )


def _summary(results: Iterable[Result], get: Callable[[Result], float]) -> str:
    values = np.array([get(r) for r in results])
    values = values[np.isfinite(values)]
    return f"{np.median(values):.4g} ({values.max():.4g})" if len(values) else "-"


def summarise(results: list[Result], preset: str) -> None:
    """Print median and worst beside the goals; of what is called ok only, for that is what is claimed."""
    own = [r for r in results if r.preset == preset]
    ok = [r for r in own if r.estimate.status == "ok"]
    counts = {status: sum(r.estimate.status == status for r in own) for status in ("ok", "degenerate", "failed")}
    z = np.array([v for r in ok for v in (r.z_rate, r.z_axis)])
    print(f"\n{preset}: {', '.join(f'{n} {status}' for status, n in counts.items())}; median (worst) of those ok")
    print("| | here | goal |\n|---|---|---|")
    print(f"| rate error, % | {_summary(ok, lambda r: r.rate_percent)} | 0.002 (0.02) |")
    print(f"| axis error, deg | {_summary(ok, lambda r: r.axis_deg)} | 0.1 (0.5) |")
    print(f"| screw line, px | {_summary(ok, lambda r: r.screw_px)} | |")
    print(f"| registration, before, % | {_summary(ok, lambda r: r.before[0])} | |")
    print(f"| registration, after, % | {_summary(ok, lambda r: r.after[0])} | 1 |")
    print(f"| error over its std below 3 | {np.mean(z < 3):.1%} of {len(z)} | 97 % |" if len(z) else "| | | |")
    print(f"| front-end, back-end, s | {', '.join(_summary(own, lambda r, k=k: r.seconds[k]) for k in (0, 1))} | |")


@contextlib.contextmanager
def folder_of(path: Path | None) -> Iterator[Path]:
    """Give the folder asked for, which is kept, or a temporary one."""
    if path is None:
        with tempfile.TemporaryDirectory() as name:
            yield Path(name)
    else:
        path.mkdir(parents=True, exist_ok=True)
        yield path


def run_scene(name: str, options: SceneOptions, folder: Path, presets: list[str], reuse_tracks: bool) -> list[Result]:
    """Simulate unless that is done, track, solve and print."""
    path = folder / f"{name}.mcap"
    if not is_written(options, path):
        write_scene(options, path)
    truth = json.loads(path.with_suffix(".truth.json").read_text())
    true = Spin(np.array(truth["axis"]), truth["spin_rate_hz"], np.array(truth["center"]), truth["t0_ns"])
    camera = open_source(path, None).camera
    surface = Surface(trimesh.load_mesh(path.with_suffix(".ply")))
    results = []
    for preset in presets:
        saved = folder / f"{name}.{preset}.npz"
        if reuse_tracks and saved.exists():
            tracked = TrackedScene.load(saved)
        else:
            tracked = track(path, camera, preset)
            tracked.save(saved)
        results.append(measure(name, preset, tracked, true, camera, surface))
        print_row(results[-1])
    return results


def main() -> None:
    """Run the scenes asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--all", action="store_true", help="all 72 scenes instead of 18")
    parser.add_argument("--scene", action="append", choices=NAMES, help="only this one; may be repeated")
    parser.add_argument("--preset", action="append", choices=tuple(BACKEND_PRESETS), help="only this one")
    parser.add_argument("--folder", type=Path, help="keep the scenes here, and take those that are there")
    parser.add_argument("--reuse-tracks", action="store_true", help="take the tracks of an earlier run from --folder")
    parser.add_argument("--revolutions", type=float, default=2.5)
    parser.add_argument("--size", type=int, nargs=2, default=(346, 260), metavar=("WIDTH", "HEIGHT"))
    args = parser.parse_args()
    base = SceneOptions(width=args.size[0], height=args.size[1], revolutions=args.revolutions)
    names = args.scene or (NAMES if args.all else SUBSET)
    presets = args.preset or ["default", "paper"]
    results: list[Result] = []
    print(
        "| scene | preset | verdict | rate, % | axis, deg | screw line, px | error/std: rate, axis | COLMAP: views, px "
        "| RMS, px | before, % | after, % | points | seconds |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|"
    )
    with folder_of(args.folder) as folder:
        for name in names:
            results += run_scene(name, topspin(base)[name], folder, presets, args.reuse_tracks)
    for preset in presets:
        summarise(results, preset)


if __name__ == "__main__":
    main()
