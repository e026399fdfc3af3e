"""`esfo run`: estimate the orbit of a recording, without ROS."""

from __future__ import annotations

import argparse
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING

from esfo_backend.options import BackendOptions
from esfo_bringup.commands.arguments import Commands, add_run_arguments, check_output, report, settings_of, source_of
from esfo_bringup.offline.pipeline import run_offline, track_offline
from esfo_bringup.offline.source import Source
from esfo_bringup.result_bag.opening import CONTENTS, EventRecorder, ResultBag
from esfo_bringup.results.event_image import EventImage
from esfo_bringup.settings import RunSettings
from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.errors import EsfoError
from esfo_core.estimate_text import printed_facts
from esfo_core.events import EventArray
from esfo_frontend.frontend import FrontendOutput
from esfo_frontend.trackers import Statistics

if TYPE_CHECKING:
    from esfo_backend.backend import Backend


def add_to(commands: Commands[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser("run", help="estimate spin and structure from a recording")
    add_run_arguments(parser)
    parser.add_argument(
        "--until", default="orbit", choices=("tracks", "orbit"), help="last stage; `tracks` writes tracks.csv alone"
    )
    parser.add_argument(
        "--bag",
        default="all",
        choices=CONTENTS,
        help="content of result.mcap: all topics of a live run, all without the events, or no such file (default all)",
    )
    parser.set_defaults(execute=execute)


def execute(args: argparse.Namespace) -> int:
    """Run the pipeline and write the results."""
    settings = settings_of(args)
    source = source_of(args)
    check_output(args.output)
    if args.until == "tracks":
        return _track(source, settings, args.output)
    Thread(target=_load_ahead, daemon=True).start()  # while the recording is read
    event_image = EventImage(source.recording.width, source.recording.height)
    activity: list[Activity] = []

    def listen(events: EventArray, output: FrontendOutput) -> None:
        event_image.add(events)
        bag.add(events, output)
        if output.activity is not None:
            activity.append(output.activity)

    with ResultBag(args.output, source, args.bag, _make_recorder) as bag:
        result = run_offline(source, settings, _make_backend, listen)
        bag.finish(result)
        from esfo_bringup.results.files import write_results

        failure: EsfoError | None = None
        try:
            write_results(result, source, event_image, activity, args.output)
        except EsfoError as error:
            failure = error  # what was computed is printed all the same
    _print_reading(source)
    if result.statistics is not None:
        _print_statistics(result.statistics)
    if bag.problem:
        print(f"not written {bag.path}: {bag.problem}")
    if failure is not None:
        print("\n".join(printed_facts(result.estimate, result.note)))
        raise failure
    bags = [bag.path.name] if bag.path.exists() else []
    return report(result, args.output, ["orbit.json", "report.html", *bags])


def _load_ahead() -> None:
    """Import slow modules in the background; an import in the main thread waits for them and raises their error."""
    with suppress(ImportError):
        import esfo_bringup.results.files  # noqa: F401


def _make_backend(camera: Camera, options: BackendOptions) -> Backend:
    from esfo_backend.backend import Backend

    return Backend(camera, options)


def _make_recorder(path: Path, source: Source, events: bool) -> EventRecorder:
    from esfo_bringup.result_bag.recorder import Recorder

    return Recorder(path, source, events)


def _track(source: Source, settings: RunSettings, folder: Path) -> int:
    tracks, statistics = track_offline(source.recording, settings)
    folder.mkdir(parents=True, exist_ok=True)
    tracks.write_csv(folder / "tracks.csv")
    _print_reading(source)
    _print_statistics(statistics)
    print(f"written     {folder}/tracks.csv")
    return 0


def _print_reading(source: Source) -> None:
    read = source.recording.statistics
    if read.outliers:
        print(f"recording   {read.outliers} events at times that those around them contradict, dropped")
    if read.segments > 1:
        print(
            f"recording   segment {source.recording.segment} of {read.segments}: the clock is set back, see esfo info"
        )


def _print_statistics(s: Statistics) -> None:
    speed = f", image speed {s.speed_px_s:.0f} px/s" if s.speed_px_s else ""
    print(f"front-end   {s.events} events, {s.corners} corners, {s.kept} kept, {s.tracks} tracks, {s.rows} rows{speed}")
