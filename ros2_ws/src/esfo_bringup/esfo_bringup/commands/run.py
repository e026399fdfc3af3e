"""`esfo run`: recording in, orbit out, without ROS."""

from __future__ import annotations

import argparse

from esfo_bringup.commands.arguments import Commands, add_run_arguments, check_output, report, settings_of, source_of
from esfo_bringup.offline import run_offline
from esfo_bringup.results import write_results


def add_to(commands: Commands[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser("run", help="estimate spin and structure from a recording")
    add_run_arguments(parser)
    parser.set_defaults(execute=execute)


def execute(args: argparse.Namespace) -> int:
    """Run the pipeline and write the results."""
    settings = settings_of(args)
    source = source_of(args)
    check_output(args.output)
    result = run_offline(source, settings)
    write_results(result, source, args.output)
    read = source.recording.statistics
    if read.segments > 1:
        print(
            f"recording   segment {source.recording.segment} of {read.segments}: the clock is set back, see esfo info"
        )
    s = result.statistics
    if s is not None:
        print(f"front-end   {s.events} events, {s.corners} corners, {s.kept} kept, {s.tracks} tracks, {s.rows} rows")
    return report(result, args.output)
