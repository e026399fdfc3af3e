"""`esfo live`: the same as `esfo run`, through ROS nodes."""

from __future__ import annotations

import argparse
import importlib.util
import signal
import subprocess
import sys

from esfo_bringup.commands.arguments import Commands, add_run_arguments, check_output, settings_of, source_of
from esfo_bringup.errors import CommandError
from esfo_bringup.result_bag.opening import bag_path


def add_to(commands: Commands[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser("live", help="the same through ROS nodes: replay, front-end and back-end over DDS")
    add_live_arguments(parser)
    parser.set_defaults(execute=execute)


def add_live_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a live run."""
    add_run_arguments(parser)
    parser.add_argument(
        "--rate",
        type=float,
        default=1.0,
        help="speed relative to real time; 0: as fast as possible without loss (default 1)",
    )


def execute(args: argparse.Namespace) -> int:
    """Check all input, then run the session in a separate process, because this command must load without ROS."""
    if importlib.util.find_spec("rclpy") is None:
        raise CommandError("ROS 2 is not in this environment: source a Jazzy install, or use make setup")
    settings_of(args)
    bag_path(args.output, source_of(args))
    check_output(args.output)
    if not args.rate >= 0:
        raise CommandError(f"--rate is {args.rate}; it takes 0 or more")
    forwarded = [str(args.recording), "-o", str(args.output), "--preset", args.preset, "--rate", str(args.rate)]
    for assignment in args.set:
        forwarded += ["-p", assignment]
    if args.topic is not None:
        forwarded += ["--topic", args.topic]
    if args.camera is not None:
        forwarded += ["--camera", str(args.camera)]
    return _run_session([sys.executable, "-m", "esfo_bringup.live", *forwarded])


def _run_session(command: list[str]) -> int:
    """Run the session in its own process group, and end it when a signal ends this process."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    process = subprocess.Popen(command, start_new_session=True)
    try:
        return process.wait()
    except KeyboardInterrupt:
        process.send_signal(signal.SIGINT)
        process.wait()  # the session ends its nodes, which takes some seconds
        raise
