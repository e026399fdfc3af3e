"""The steps of a run as functions; all behaviour is in the packages below."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from esfo.result import Result, TrackedRecording, Update
from esfo_backend.backend import Backend
from esfo_bringup.offline.pipeline import RunResult, solve_offline, track_offline
from esfo_bringup.offline.source import Source, open_source
from esfo_bringup.results.event_image import EventImage
from esfo_bringup.settings import RunSettings, settings_for, share_out
from esfo_core.camera import Camera
from esfo_core.errors import OptionError
from esfo_core.events import EventArray
from esfo_core.options import replace
from esfo_core.recordings import ReadingOptions
from esfo_frontend.frontend import FrontendOutput
from esfo_simulation.scene import SceneOptions
from esfo_simulation.scene_files import write_scene
from esfo_simulation.truth import Truth


def open(
    path: str | Path, camera: Camera | str | Path | None = None, topic: str | None = None, **reading: str | int
) -> Source:
    """Open a recording of any known format with the camera to use.

    camera: calibration, or the path of a ROS `camera_calibration` YAML file; None: that of the recording, or else an
    assumed lens of 53 degrees (`Source.assumed`). topic: event topic of a bag that has several. reading: fields of
    `ReadingOptions` that the file does not tell, such as width and height.

    Raises RecordingError, CameraError and OptionError.
    """
    given = Path(camera) if isinstance(camera, str) else camera
    return open_source(Path(path), given, topic, replace(ReadingOptions(), reading))


def settings(preset: str = "default", values: Mapping[str, object] | None = None) -> RunSettings:
    """Return the options of front-end and back-end of a preset, `default` or `paper`, with single ones changed.

    values: options by their dotted names, as `esfo run -p` takes them.

    Raises OptionError for an unknown preset or name, a value out of range, and options of reading, which `open` takes.
    """
    values = values or {}
    reading = share_out(values).reading
    if reading:
        raise OptionError(f"{', '.join(reading)}: an option of reading, which esfo.open takes")
    return settings_for(preset, values)


def track(source: Source, settings: RunSettings | None = None) -> TrackedRecording:
    """Read the whole recording and track features in it. Raises RecordingError; settings None: the defaults."""
    settings = settings or settings_for("default", {})
    image = EventImage(source.recording.width, source.recording.height)
    updates: list[Update] = []

    def listen(events: EventArray, output: FrontendOutput) -> None:
        image.add(events)
        updates.append((output.tracks, output.activity, output.pyramid))

    tracks, statistics = track_offline(source.recording, settings, listen)
    return TrackedRecording(source, settings, tracks, statistics, tuple(updates), image)


def estimate(tracked: TrackedRecording, settings: RunSettings | None = None) -> Result:
    """Estimate spin and structure from what was tracked; a result that cannot be trusted says so in its status.

    settings None: those of the tracking.
    """
    backend = Backend(tracked.source.camera, (settings or tracked.settings).backend)
    for update in tracked.updates:
        backend.add(*update)
    found, note = solve_offline(backend, tracked.source)
    return Result(tracked, RunResult(found, tracked.tracks, tracked.statistics, note))


def run(source: Source, settings: RunSettings | None = None) -> Result:
    """`track`, then `estimate`: the result of `esfo run`. Raises RecordingError; settings None: the defaults."""
    return estimate(track(source, settings))


def simulate(path: str | Path, options: SceneOptions | None = None, **values: str | float | bool) -> Truth:
    """Simulate a spinning object; write the recording `path` (.mcap) and, beside it, its truth, mesh and true tracks.

    values: fields of `SceneOptions` that differ from `options`, by dotted names. Returns what is known of the motion.

    Raises OptionError, SimulationError, CameraError and RecordingError.
    """
    return write_scene(replace(options or SceneOptions(), values), Path(path))
