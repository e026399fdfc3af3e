"""The pipeline without ROS: runs the Frontend and the Backend of the nodes on a recording."""

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
"""The class `Backend`, or a function that imports it first: tracking can begin during that second."""
_MOST_WAITING = 500
"""Chunks of a recording that may wait until the back-end is loaded."""

Listener = Callable[[EventArray, FrontendOutput], None]
"""Called with each chunk of events and what it settles in the front-end."""


@dataclass(frozen=True)
class RunResult:
    """Result of a run: the estimate, all tracks, and the counts of the front-end (None after a live run).

    note: remark on the initialisation, empty where there is none.
    """

    estimate: OrbitEstimate
    tracks: Tracks
    statistics: Statistics | None
    note: str


def run_offline(
    source: Source, settings: RunSettings, make_backend: MakeBackend, listen: Listener | None = None
) -> RunResult:
    """Track the whole recording, then estimate once. Raises RecordingError for a recording without events.

    make_backend: called when the first tracks are handed over. listen: called for every chunk of events, and at the
    end, without events, for what was pending.
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
    estimate, note = solve_offline(backend, source)
    estimate = replace(estimate, timing_s={"tracking": round(tracking_s, 3), **estimate.timing_s})
    return RunResult(estimate, Tracks.concatenate(tracks).sorted(), frontend.statistics, note)


def _hand_over(waiting: list[FrontendOutput], backend: Backend) -> None:
    for output in waiting:
        backend.add(output.tracks, output.activity, output.pyramid)
    waiting.clear()


def track_offline(
    recording: Recording, settings: RunSettings, listen: Listener | None = None
) -> tuple[Tracks, Statistics]:
    """Track the whole recording without an estimate. Raises RecordingError for a recording without events.

    listen: as of `run_offline`.
    """
    frontend = Frontend(recording, settings.frontend)
    tracks = Tracks.concatenate(output.tracks.observations for output in _outputs(frontend, recording, listen))
    return tracks.sorted(), frontend.statistics


def solve_offline(backend: Backend, source: Source) -> tuple[OrbitEstimate, str]:
    """Estimate from everything that the back-end was given of the source, with a bar of the stages.

    Returns the estimate and what became of COLMAP.
    """
    with stage_bar(len(STAGES)) as bar:
        estimate = with_source(backend.solve(on_stage=lambda name: next_stage(bar, name)), source)
    return estimate, "" if backend.last_search is None else backend.last_search.note


def _outputs(frontend: Frontend, recording: Recording, listen: Listener | None = None) -> Iterator[FrontendOutput]:
    """Yield the outputs of the front-end up to the end of the recording."""
    for events, output in frontend.run(follow(recording, recording.chunks(), "tracking")):
        if not frontend.statistics.events:
            raise RecordingError(f"{recording.path}: no events")
        if listen is not None:
            listen(events, output)
        yield output
