"""The pipeline without ROS: the same Frontend and Backend as in the nodes, driven by a recording."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

from esfo_backend.options import BackendOptions
from esfo_backend.stopwatch import STAGES
from esfo_bringup.offline.source import Source, with_source
from esfo_bringup.progress import follow, next_stage, stage_bar
from esfo_bringup.settings import RunSettings
from esfo_core.camera import Camera
from esfo_core.errors import RecordingError
from esfo_core.estimate import OrbitEstimate
from esfo_core.events import EventArray
from esfo_core.recordings import Recording
from esfo_core.tracks import Tracks
from esfo_frontend.frontend import Frontend, FrontendOutput
from esfo_frontend.trackers import Statistics

if TYPE_CHECKING:
    from esfo_backend.backend import Backend

MakeBackend = Callable[[Camera, BackendOptions], "Backend"]
"""The class `Backend`, or a function that loads it first: that takes a second, in which tracking can begin."""
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


def run_offline(
    source: Source, settings: RunSettings, make_backend: MakeBackend, listen: Listener | None = None
) -> RunResult:
    """Track the whole recording, then estimate once. Raises RecordingError for a recording without events.

    make_backend: called when the first tracks are handed over. listen: called for every chunk of events, and at the end
    without events for what was pending.
    """
    recording = source.recording
    frontend = Frontend(recording, settings.frontend)
    ready: Callable[[], Backend] = cache(lambda: make_backend(source.camera, settings.backend))
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
        estimate = with_source(backend.solve(on_stage=lambda name: next_stage(bar, name)), source)
    estimate = replace(estimate, timing_s={"tracking": round(tracking_s, 3), **estimate.timing_s})
    note = "" if backend.last_search is None else backend.last_search.note
    return RunResult(estimate, Tracks.concatenate(tracks).sorted(), frontend.statistics, note)


def _hand_over(waiting: list[FrontendOutput], backend: Backend) -> None:
    for output in waiting:
        backend.add(output.tracks, output.activity)
    waiting.clear()


def track_offline(recording: Recording, settings: RunSettings) -> tuple[Tracks, Statistics]:
    """Track the whole recording and leave it at that. Raises RecordingError for a recording without events."""
    frontend = Frontend(recording, settings.frontend)
    tracks = Tracks.concatenate(output.tracks.observations for output in _outputs(frontend, recording))
    return tracks.sorted(), frontend.statistics


def _outputs(frontend: Frontend, recording: Recording, listen: Listener | None = None) -> Iterator[FrontendOutput]:
    """Yield what the front-end makes of the recording, its end included."""
    for events, output in frontend.run(follow(recording, recording.chunks(), "tracking")):
        if not frontend.statistics.events:
            raise RecordingError(f"{recording.path}: no events")
        if listen is not None:
            listen(events, output)
        yield output
