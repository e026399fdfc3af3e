"""Arguments that several commands share."""

from __future__ import annotations

import argparse
import os
import textwrap
from collections.abc import Sequence
from pathlib import Path

from esfo_bringup.commands.reading import add_assignments, add_recording
from esfo_bringup.errors import CommandError
from esfo_bringup.offline.pipeline import RunResult
from esfo_bringup.offline.source import Source, open_source
from esfo_bringup.settings import RunSettings, common_options, settings_for, share_out
from esfo_core.estimate_text import printed_facts
from esfo_core.options import parse_assignments, replace
from esfo_core.recordings import ReadingOptions

Commands = argparse._SubParsersAction  # argparse has no public name for this type


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that `run` and `live` share."""
    add_recording(parser)
    parser.add_argument("--camera", type=Path, metavar="YAML", help="camera_calibration file (default: in the bag)")
    parser.add_argument("--preset", default="default", choices=("default", "paper"), help="values of all options")
    add_assignments(parser, "set one option of the pipeline or of reading; may be repeated")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the results")
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = common_options_text()


def common_options_text() -> str:
    """Return the options that users change most, each with its default, choices and meaning."""
    lines = ["options that users change most (-p NAME:=VALUE; docs/interfaces.md lists all):"]
    for leaf in common_options():
        choices = f" [{', '.join(leaf.choices)}]" if leaf.choices else ""
        text = f"default {leaf.value}{choices}; {leaf.meaning}"
        lines += textwrap.wrap(f"{leaf.name:<22} {text}", 100, initial_indent="  ", subsequent_indent=" " * 25)
    return "\n".join(lines)


def settings_of(args: argparse.Namespace) -> RunSettings:
    """Return the settings by the preset and the assignments among the arguments."""
    return settings_for(args.preset, parse_assignments(args.set))


def source_of(args: argparse.Namespace) -> Source:
    """Open the recording and the camera that the arguments name."""
    reading = replace(ReadingOptions(), share_out(parse_assignments(args.set)).reading)
    return open_source(args.recording, args.camera, args.topic, reading)


def check_output(folder: Path) -> None:
    """Raise CommandError unless results can be written to `folder`; called before the work begins."""
    if folder.exists() and not folder.is_dir():
        raise CommandError(f"{folder} is not a folder")
    parent = folder if folder.is_dir() else next(p for p in folder.absolute().parents if p.exists())
    if not os.access(parent, os.W_OK):
        raise CommandError(f"{parent} cannot be written to")


def report(result: RunResult, folder: Path, files: Sequence[str] = ("orbit.json", "report.html")) -> int:
    """Print the result and the names of its files; return 0.

    Raises CommandError with the reason when the status is not `ok`.
    """
    for line in printed_facts(result.estimate, result.note):
        print(line)
    print(f"written     {folder}/{', '.join(files)}")
    if result.estimate.status != "ok":
        raise CommandError(f"{result.estimate.status}: {result.estimate.reason}")
    return 0
