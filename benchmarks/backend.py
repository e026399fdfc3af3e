"""Accuracy and honesty of the back-end over simulated twins of the paper's scenes: prints the tables of the docs.

The same as `esfo benchmark topspin`, but that it makes the scenes where they are missing, of its own choice of 18, and
may keep their tracks from one run to the next.
"""

from __future__ import annotations

import argparse
import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from provenance import print_provenance

from esfo_backend.options import PRESETS
from esfo_bringup.benchmark.orbit_accuracy import (
    OrbitResult,
    TrackedScene,
    TrueScene,
    measure_orbit,
    open_scene,
    track,
)
from esfo_bringup.benchmark.orbit_table import HEADER, row_of, summarise
from esfo_bringup.settings import settings_for
from esfo_core.activity import Activity
from esfo_core.tracks import Tracks
from esfo_frontend.options import FrontendOptions
from esfo_simulation.objects.catalogue import OBJECTS
from esfo_simulation.scene import SPEEDS_HZ, VIEWS, SceneOptions
from esfo_simulation.scene_files import is_written, topspin, write_scene

NAMES = tuple(topspin(SceneOptions()))
SUBSET = tuple(
    NAMES[(o * len(VIEWS) + (o + s) % len(VIEWS)) * len(SPEEDS_HZ) + s]
    for o in range(len(OBJECTS))
    for s in range(len(SPEEDS_HZ))
)
"""18 of the 72: every object at every speed, the views in turn."""


def save(tracked: TrackedScene, path: Path) -> None:
    """Write as `.npz`."""
    t, a = tracked.tracks, tracked.activity
    np.savez(
        path,
        track_id=t.track_id,
        t=t.t,
        uv=t.uv,
        sigma=t.sigma,
        counts=a.counts,
        grid=[a.t0, a.bin, a.cell],
        seconds=tracked.seconds,
    )


def load(path: Path) -> TrackedScene:
    """Read what `save` wrote."""
    with np.load(path) as f:
        activity = Activity(*(int(v) for v in f["grid"]), f["counts"])
        tracks = Tracks.from_columns(f["track_id"], f["t"], f["uv"], f["sigma"])
        return TrackedScene(tracks, activity, float(f["seconds"]))


def tracked_of(scene: TrueScene, options: FrontendOptions, saved: Path, reuse: bool) -> TrackedScene:
    """Track, or take the tracks of an earlier run."""
    if reuse and saved.exists():
        return load(saved)
    tracked = track(scene.recording.chunks(), scene.camera, options)
    save(tracked, saved)
    return tracked


@contextlib.contextmanager
def folder_of(path: Path | None) -> Iterator[Path]:
    """Give the folder asked for, which is kept, or a temporary one."""
    if path is None:
        with tempfile.TemporaryDirectory() as name:
            yield Path(name)
    else:
        path.mkdir(parents=True, exist_ok=True)
        yield path


def run_scene(options: SceneOptions, path: Path, presets: list[str], reuse_tracks: bool) -> list[OrbitResult]:
    """Simulate unless that is done, track, solve and print."""
    if not is_written(options, path):
        write_scene(options, path)
    results = []
    for preset in presets:
        scene, settings = open_scene(path), settings_for(preset, {})
        tracked = tracked_of(scene, settings.frontend, path.with_suffix(f".{preset}.npz"), reuse_tracks)
        results.append(measure_orbit(scene, preset, settings, tracked))
        print(row_of(results[-1]), flush=True)
    return results


def main() -> None:
    """Run the scenes asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--all", action="store_true", help="all 72 scenes instead of 18")
    parser.add_argument("--scene", action="append", choices=NAMES, help="only this one; may be repeated")
    parser.add_argument("--preset", action="append", choices=tuple(PRESETS), help="only this one")
    parser.add_argument("--folder", type=Path, help="keep the scenes here, and take those that are there")
    parser.add_argument("--reuse-tracks", action="store_true", help="take the tracks of an earlier run from --folder")
    parser.add_argument("--revolutions", type=float, default=2.5)
    parser.add_argument("--size", type=int, nargs=2, default=(346, 260), metavar=("WIDTH", "HEIGHT"))
    args = parser.parse_args()
    print_provenance()
    scenes = topspin(SceneOptions(width=args.size[0], height=args.size[1], revolutions=args.revolutions))
    presets = args.preset or ["default", "paper"]
    results: list[OrbitResult] = []
    print(*HEADER, sep="\n")
    with folder_of(args.folder) as folder:
        for name in args.scene or (NAMES if args.all else SUBSET):
            results += run_scene(scenes[name], folder / f"{name}.mcap", presets, args.reuse_tracks)
    for preset in presets:
        print("", *summarise(results, preset).lines(), sep="\n")


if __name__ == "__main__":
    main()
