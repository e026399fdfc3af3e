"""`esfo convert`: write any recording as a ROS 2 bag of event packets."""

from __future__ import annotations

import argparse
from itertools import chain
from pathlib import Path

from esfo_bringup.commands.arguments import Commands
from esfo_bringup.commands.info import INFERRED
from esfo_bringup.commands.reading import add_reading_arguments, opened
from esfo_bringup.errors import CommandError
from esfo_bringup.offline.source import choose_camera
from esfo_bringup.progress import follow
from esfo_core.codecs import WRITABLE
from esfo_core.recordings import Recording, write_mcap


def add_to(commands: Commands[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser("convert", help="write a recording as a ROS 2 bag (MCAP), losslessly")
    add_reading_arguments(parser)
    parser.add_argument("output", type=Path, metavar="OUT.mcap")
    parser.add_argument("--encoding", default="mono", choices=WRITABLE, help="default mono; evt3 is smaller")
    parser.add_argument(
        "--round-times", action="store_true", help="with evt3: round times down to its microseconds, not losslessly"
    )
    parser.add_argument("--camera", type=Path, metavar="YAML", help="camera_calibration file (default: in the bag)")
    parser.set_defaults(execute=execute)


def execute(args: argparse.Namespace) -> int:
    """Copy all events, the camera and the offset of the host's clock; external triggers are left out."""
    if args.output.suffix != ".mcap":
        raise CommandError(f"{args.output} does not end in .mcap")
    recording = opened(args, args.camera)
    if args.output.exists() and args.output.samefile(args.recording):
        raise CommandError(f"{args.output} is the recording itself")
    camera = choose_camera(recording, str(args.camera or ""))
    args.output.parent.mkdir(parents=True, exist_ok=True)
    chunks = recording.chunks()
    first = next(chunks)  # decoding it finds the offset of the host's clock
    followed = follow(recording, chain([first], chunks), "converting")
    size = (recording.width, recording.height)
    offset = recording.statistics.host_offset or 0
    count = write_mcap(args.output, followed, camera or size, args.encoding, args.round_times, offset)
    print(f"written     {args.output}: {count} events, {args.encoding}, {args.output.stat().st_size} bytes")
    print(f"read        {recording.path}: {recording.format}, {recording.size_bytes} bytes")
    if recording.size_inferred:
        print(f"sensor      {size[0]}x{size[1]} px{INFERRED}")
    for fact in _left_out(recording):
        print(f"left out    {fact}")
    return 0


def _left_out(recording: Recording) -> list[str]:
    """Return what the recording has and the bag has not."""
    s, d = recording.statistics, recording.statistics.decoder
    counts = {
        "external triggers": d.triggers_rising + d.triggers_falling,
        "events outside the sensor": d.out_of_range,
        "events before the first time or address of their stream": d.unsynchronised,
        "events at impossible times": d.impossible_times,
        "words of no known code": d.unknown_words,
        f"lines that are no events, the first {s.first_fault}": d.bad_lines,
        "packets that are missing in the recording": s.packets_lost,
        "packets that cannot be read": s.packets_damaged,
        "events at times that those around them contradict": s.outliers,
        f"events of other segments than {recording.segment}: the clock is set back": s.events_elsewhere,
        "bytes after the last whole packet": s.bytes_lost + d.trailing_bytes,
    }
    return [f"{count} {name}" for name, count in counts.items() if count]
