"""Arguments for opening a recording."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from esfo_core.camera import Camera
from esfo_core.options import fields_of, parse_assignments, replace
from esfo_core.recordings import Recording, open_recording
from esfo_core.recordings.reading_options import ReadingOptions


def add_reading_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the recording, and the options for what its file does not tell."""
    add_recording(parser)
    names = ", ".join(leaf.name for leaf in fields_of(ReadingOptions()))
    add_assignments(parser, f"what the file does not tell: {names}")


def add_recording(parser: argparse.ArgumentParser) -> None:
    """Add the recording itself."""
    parser.add_argument("recording", type=Path, help="bag (file or folder) or event file of any known format")
    parser.add_argument("--topic", help="event topic of a bag, where it has several")


def add_assignments(parser: argparse.ArgumentParser, meaning: str) -> None:
    """Add `-p NAME:=VALUE`, collected in `args.set`."""
    parser.add_argument("-p", dest="set", action="append", default=[], metavar="NAME:=VALUE", help=meaning)


def opened(args: argparse.Namespace, camera_file: Path | None = None) -> Recording:
    """Open the recording that the arguments name; a camera file tells the sensor size where no option does.

    Raises RecordingError, OptionError and CameraError.
    """
    options = replace(ReadingOptions(), parse_assignments(args.set))
    if camera_file is not None and options.size is None:
        camera = Camera.read_yaml(camera_file)
        options = dataclasses.replace(options, width=camera.width, height=camera.height)
    return open_recording(args.recording, args.topic, options)
