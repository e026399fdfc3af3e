"""Simulated scenes as files: recording, truth, mesh and true tracks; and the 72 scenes of TOPSPIN."""

from __future__ import annotations

import json
from collections.abc import Generator, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from esfo_core.events import EventArray
from esfo_core.options import fields_of
from esfo_core.recordings import open_recording, write_mcap
from esfo_core.recordings.event_camera_dataset import write_event_camera_dataset
from esfo_simulation.handheld.scene import HandheldOptions, handheld_scene
from esfo_simulation.landmarks import choose_points, true_tracks
from esfo_simulation.objects.catalogue import OBJECTS
from esfo_simulation.scene import SPEEDS_HZ, VIEWS, Scene, SceneOptions, simulate
from esfo_simulation.simulator import Progress
from esfo_simulation.truth import Truth

LANDMARKS = 300
LANDMARK_PERIOD_NS = 10_000_000

_SHORT = {"medium": "med"}  # as the paper abbreviates in the names of its scenes


def write_scene(options: SceneOptions, path: Path, progress: Progress | None = None) -> Truth:
    """Simulate and write `path` (MCAP) and, beside it by its stem, what is known of it.

    `.ply`: the mesh, and `.points.ply`: up to 300 corners of it, both camera-aligned at the first event. `.tracks.csv`:
    where these corners are seen every 10 ms, each a track by its number, with rows only while it is visible.
    `.truth.json`: the motion, the last to be written: where it is, all is. The same options give the same bytes.

    Raises OptionError, SimulationError, CameraError and RecordingError.
    """
    scene = simulate(options)
    passing = _Passing(scene.chunks(progress))
    truth_path = path.with_suffix(".truth.json")
    truth_path.unlink(missing_ok=True)
    count = write_mcap(path, passing, scene.camera)
    _write_landmarks(scene, passing.span, path)
    truth = Truth(scene.motion, passing.span, count, passing.lost, _values(options))
    truth.write_json(truth_path)
    return truth


class _Passing:
    """Chunks of a simulation on their way to a file.

    span: times of the first and the last event so far, ns. lost: events that the read-out lost, known at the end.
    """

    def __init__(self, chunks: Generator[EventArray, None, int]) -> None:
        self.span, self.lost = (0, 0), 0
        self._chunks = chunks

    def __iter__(self) -> Iterator[EventArray]:
        try:
            while True:
                events = next(self._chunks)
                self.span = (self.span[0] or int(events["t"][0]), int(events["t"][-1]))
                yield events
        except StopIteration as end:
            self.lost = end.value


def _write_landmarks(scene: Scene, span: tuple[int, int], path: Path) -> None:
    model, simulation = scene.model_at(span[0]), scene.simulation
    model.to_trimesh().export(path.with_suffix(".ply"))
    points = choose_points(model, LANDMARKS, scene.options.seed)
    cloud = trimesh.PointCloud(model.vertices[points])  # type: ignore[no-untyped-call]
    cloud.export(path.with_suffix(".points.ply"))  # type: ignore[no-untyped-call]
    times = np.arange(*span, LANDMARK_PERIOD_NS)
    tracks = true_tracks(simulation.model, points, simulation.camera, scene.motion, times)
    tracks.write_csv(path.with_suffix(".tracks.csv"))


def write_handheld(options: HandheldOptions, folder: Path, progress: Progress | None = None) -> tuple[int, int]:
    """Simulate a moving camera and write `folder` in the form of the Event Camera Dataset.

    Returns the number of events and how many others the read-out of the sensor lost.

    Beside its `events.txt`, `groundtruth.txt` (poses at 200 Hz) and `calib.txt` the same events as `events.mcap`, and
    the scene as `scene.ply`, in the world of the poses. Raises OptionError and RecordingError.
    """
    scene = handheld_scene(options)
    folder.mkdir(parents=True, exist_ok=True)
    recording = folder / "events.mcap"
    passing = _Passing(scene.simulation.chunks(progress))
    count = write_mcap(recording, passing, scene.simulation.camera)
    write_event_camera_dataset(folder, open_recording(recording).chunks(), scene.trajectory, scene.simulation.camera)
    scene.simulation.model.to_trimesh().export(folder / "scene.ply")
    return count, passing.lost


def is_written(options: SceneOptions, path: Path) -> bool:
    """Return whether `write_scene` has already written these files with the same options."""
    try:
        truth = json.loads(path.with_suffix(".truth.json").read_text())
    except (OSError, ValueError):
        return False
    return path.is_file() and isinstance(truth, dict) and truth.get("options") == _values(options)


def topspin(base: SceneOptions) -> dict[str, SceneOptions]:
    """Return the 72 scenes of the paper's data set (Table 1) by name: what, seen from where, how fast.

    Everything but these three is as in `base`.
    """
    return {
        f"{what}-{view}-{_SHORT.get(speed, speed)}": replace(base, object=what, view=view, speed=speed)
        for what in OBJECTS
        for view in VIEWS
        for speed in SPEEDS_HZ
    }


def _values(options: SceneOptions) -> dict[str, bool | int | float | str]:
    return {leaf.name: leaf.value for leaf in fields_of(options)}
