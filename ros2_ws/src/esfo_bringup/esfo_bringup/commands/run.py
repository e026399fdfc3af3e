"""`esfo run`: recording in, orbit out, without ROS."""

from __future__ import annotations

import argparse

from esfo_bringup.commands.arguments import Commands, add_run_arguments, check_output, report, settings_of, source_of
from esfo_bringup.exposure import Exposure
from esfo_bringup.offline import Source, run_offline, track_offline
from esfo_bringup.results import write_results
from esfo_frontend.pipelines import Statistics


def add_to(commands: Commands[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser("run", help="estimate spin and structure from a recording")
    add_run_arguments(parser)
    parser.add_argument(
        "--until", default="orbit", choices=("tracks", "orbit"), help="last stage; `tracks` writes tracks.csv alone"
    )
    parser.set_defaults(execute=execute)


def execute(args: argparse.Namespace) -> int:
    """Run the pipeline and write the results."""
    settings = settings_of(args)
    source = source_of(args)
    check_output(args.output)
    if args.until == "tracks":
        tracks, statistics = track_offline(source.recording, settings)
        args.output.mkdir(parents=True, exist_ok=True)
        tracks.write_csv(args.output / "tracks.csv")
        _print_reading(source)
        _print_statistics(statistics)
        print(f"written     {args.output}/tracks.csv")
        return 0
    exposure = Exposure(source.recording.width, source.recording.height)
    result = run_offline(source, settings, lambda events, _: exposure.add(events))
    write_results(result, source, exposure, args.output)
    _print_reading(source)
    if result.statistics is not None:
        _print_statistics(result.statistics)
    return report(result, args.output)


def _print_reading(source: Source) -> None:
    read = source.recording.statistics
    if read.segments > 1:
        print(
            f"recording   segment {source.recording.segment} of {read.segments}: the clock is set back, see esfo info"
        )


def _print_statistics(s: Statistics) -> None:
    speed = f", image speed {s.speed_px_s:.0f} px/s" if s.speed_px_s else ""
    print(f"front-end   {s.events} events, {s.corners} corners, {s.kept} kept, {s.tracks} tracks, {s.rows} rows{speed}")
