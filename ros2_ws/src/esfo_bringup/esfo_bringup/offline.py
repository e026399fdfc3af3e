"""The pipeline without ROS: the same Frontend and Backend as in the nodes, driven by a recording."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from esfo_backend.stopwatch import STAGES
from esfo_bringup.progress import follow, next_stage, stage_bar
from esfo_bringup.replay.player import check_size
from esfo_bringup.settings import RunSettings
from esfo_core.camera import Camera
from esfo_core.errors import RecordingError
from esfo_core.estimate import OrbitEstimate
from esfo_core.events import EventArray, empty_events
from esfo_core.recordings import ReadingOptions, Recording, open_recording
from esfo_core.tracks import Tracks
from esfo_frontend.frontend import Frontend, FrontendOutput
from esfo_frontend.pipelines import Statistics

if TYPE_CHECKING:
    from esfo_backend.backend import Backend

BACKEND = "esfo_backend.backend"
"""Loaded when the first tracks are handed over, or before by who wants to save the time."""
_MOST_WAITING = 500
"""Chunks of a recording that may wait until the back-end is loaded."""

Listener = Callable[[EventArray, FrontendOutput], None]
"""Gets the events of a run as they stream, with what they settle in the front-end."""


@dataclass(frozen=True)
class RunResult:
    """Outcome of a run: the estimate, all tracks, and what the front-end counted (None after a live run)."""

    estimate: OrbitEstimate
    tracks: Tracks
    statistics: Statistics | None
    note: str


@dataclass(frozen=True)
class Source:
    """A recording with the camera to use; assumed: the camera is a guess, because nothing tells it."""

    recording: Recording
    camera: Camera
    assumed: bool


def open_source(
    path: Path, camera_file: Path | None, topic: str | None = None, options: ReadingOptions | None = None
) -> Source:
    """Open a recording and find its camera: the file given, that of the recording, or a guess that is named so.

    topic, options: what the recording does not tell; a camera file tells the sensor size. Raises RecordingError, and
    CameraError when the camera is of another size than the sensor.
    """
    reading = options or ReadingOptions()
    given = None if camera_file is None else Camera.read_yaml(camera_file)
    if given is not None and reading.size is None:
        reading = replace(reading, width=given.width, height=given.height)
    recording = open_recording(path, topic, reading)
    camera = given or recording.camera
    if camera is None:
        # A lens of 53 degrees: the rate hardly depends on it, the axis does.
        return Source(recording, Camera.pinhole(recording.width, recording.height, float(recording.width)), True)
    check_size(camera, recording, "the camera")
    return Source(recording, camera, False)


def run_offline(source: Source, settings: RunSettings, listen: Listener | None = None) -> RunResult:
    """Track the whole recording, then estimate once. Raises RecordingError for a recording without events.

    listen: called for every chunk of events, and at the end without events for what was pending.
    """
    recording = source.recording
    frontend = Frontend(recording.width, recording.height, settings.frontend)
    ready: Callable[[], Backend] = cache(lambda: import_module(BACKEND).Backend(source.camera, settings.backend))
    tracks: list[Tracks] = []
    waiting: list[FrontendOutput] = []
    begin = time.perf_counter()
    for output in _outputs(frontend, recording, listen):
        tracks.append(output.tracks.observations)
        waiting.append(output)
        if len(waiting) == _MOST_WAITING:
            _hand_over(waiting, ready())
    tracking_s = time.perf_counter() - begin
    backend = ready()
    _hand_over(waiting, backend)
    with stage_bar(len(STAGES)) as bar:
        backend.tell_stages(lambda name: next_stage(bar, name))
        estimate = with_source(backend.solve(), source)
    estimate = replace(estimate, timing_s={"tracking": round(tracking_s, 3), **estimate.timing_s})
    return RunResult(estimate, Tracks.concatenate(tracks).sorted(), frontend.statistics, backend.last_start_note)


def _hand_over(waiting: list[FrontendOutput], backend: Backend) -> None:
    for output in waiting:
        backend.add(output.tracks, output.activity)
    waiting.clear()


def track_offline(recording: Recording, settings: RunSettings) -> tuple[Tracks, Statistics]:
    """Track the whole recording and leave it at that. Raises RecordingError for a recording without events."""
    frontend = Frontend(recording.width, recording.height, settings.frontend)
    tracks = Tracks.concatenate(output.tracks.observations for output in _outputs(frontend, recording))
    return tracks.sorted(), frontend.statistics


def _outputs(frontend: Frontend, recording: Recording, listen: Listener | None = None) -> Iterator[FrontendOutput]:
    """Yield what the front-end makes of the recording, its end included."""
    for events in follow(recording, recording.chunks(), "tracking"):
        output = frontend.process(events)
        if listen is not None:
            listen(events, output)
        yield output
    if not frontend.statistics.events:
        raise RecordingError(f"{recording.path}: no events")
    output = frontend.flush()
    if listen is not None:
        listen(empty_events(), output)
    yield output


def with_source(estimate: OrbitEstimate, source: Source) -> OrbitEstimate:
    """Name what the source leaves open: `intrinsics_assumed` when the camera is a guess."""
    if not source.assumed:
        return estimate
    return replace(estimate, flags=(*estimate.flags, "intrinsics_assumed"))
