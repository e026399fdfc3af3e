"""`esfo benchmark`: accuracy against truth, and throughput."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

from esfo_bringup.benchmark import orbit_table, throughput, track_accuracy
from esfo_bringup.benchmark.orbit_accuracy import OrbitResult, find_scenes, measure_orbit, open_scene, track
from esfo_bringup.commands.arguments import Commands
from esfo_bringup.commands.reading import add_assignments
from esfo_bringup.errors import CommandError
from esfo_bringup.settings import RunSettings, settings_for, share_out
from esfo_core.options import parse_assignments, replace
from esfo_core.recordings import ReadingOptions, open_recording
from esfo_core.result_files import versions
from esfo_frontend.options import PRESETS
from esfo_frontend.warm_up import warm_up


class BenchmarkResult(Protocol):
    """Result of a benchmark on one recording."""

    def to_json(self) -> dict[str, Any]:
        """Return its values by name."""


R = TypeVar("R", bound=BenchmarkResult)


def add_to(commands: Commands[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser("benchmark", help="measure accuracy against truth, or throughput")
    kinds = parser.add_subparsers(dest="benchmark", required=True, metavar="WHAT")
    topspin = kinds.add_parser("topspin", help="rate, axis and shape over recordings with .truth.json")
    topspin.add_argument("folder", type=Path, metavar="DIR", help="what `esfo simulate --topspin -o DIR` wrote")
    dataset = kinds.add_parser("event-camera-dataset", help="tracks over folders with events.txt")
    dataset.add_argument("folder", type=Path, metavar="DIR", help="folder of the dataset, or one that holds some")
    speed = kinds.add_parser("throughput", help="events per second of reading, corners and the whole front-end")
    speed.add_argument("recordings", nargs="+", type=Path, metavar="RECORDING", help="event file of any known format")
    for kind, execute in ((topspin, _topspin), (dataset, _event_camera_dataset), (speed, _throughput)):
        kind.add_argument(
            "--preset", action="append", choices=tuple(PRESETS), help="may be repeated (default: default)"
        )
        add_assignments(kind, "set one option of the pipeline or of reading; may be repeated")
        kind.add_argument("--json", action="store_true", help="print one JSON document instead of a table")
        kind.set_defaults(execute=execute)


def _topspin(args: argparse.Namespace) -> int:
    """Solve every scene below the folder under every preset; a preset without a result `ok` is not an error."""
    presets = _presets(args)
    paths = find_scenes(args.folder)
    _compile(presets)

    def measured() -> Iterator[OrbitResult]:
        for path in paths:
            scene = open_scene(path)
            for preset, settings in presets.items():
                tracked = track(scene.recording.chunks(), scene.camera, settings.frontend)
                yield measure_orbit(scene, preset, settings, tracked)

    results = _printed(args, orbit_table.HEADER, measured(), orbit_table.row_of)
    summaries = [orbit_table.summarise(results, preset) for preset in presets]
    if args.json:
        _print_json(args, results, summary=[summary.to_json() for summary in summaries])
        return 0
    for summary in summaries:
        print("", *summary.lines(), sep="\n")
    return 0


def _event_camera_dataset(args: argparse.Namespace) -> int:
    presets = _presets(args)
    folders = track_accuracy.find_recordings(args.folder)
    _compile(presets)
    measured = (
        track_accuracy.measure_tracks(folder, preset, settings.frontend)
        for folder in folders
        for preset, settings in presets.items()
    )
    results = _printed(args, track_accuracy.HEADER, measured, track_accuracy.row_of)
    if args.json:
        _print_json(args, results)
    return 0


def _throughput(args: argparse.Namespace) -> int:
    if args.preset and len(args.preset) > 1:
        raise CommandError("throughput takes one preset at a time")
    (settings,) = _presets(args).values()
    reading = replace(ReadingOptions(), share_out(parse_assignments(args.set)).reading)
    measured = (
        throughput.measure_throughput(open_recording(path, None, reading), settings.frontend)
        for path in args.recordings
    )
    results = _printed(args, throughput.HEADER, measured, throughput.row_of)
    if args.json:
        _print_json(args, results)
    return 0


def _presets(args: argparse.Namespace) -> dict[str, RunSettings]:
    """Return the settings by the names of the presets that were asked for."""
    values = parse_assignments(args.set)
    return {name: settings_for(name, values) for name in args.preset or ["default"]}


def _compile(presets: dict[str, RunSettings]) -> None:
    """Compile the front-end, so that no measured time contains it."""
    for settings in presets.values():
        warm_up(settings.frontend)


def _printed(
    args: argparse.Namespace, header: Iterable[str], measured: Iterable[R], row_of: Callable[[R], str]
) -> list[R]:
    """Collect the results and print each one when it is there, unless JSON was asked for."""
    if not args.json:
        print(*header, sep="\n")
    results = []
    for result in measured:
        results.append(result)
        if not args.json:
            print(row_of(result), flush=True)
    return results


def _print_json(args: argparse.Namespace, results: Sequence[BenchmarkResult], **more: object) -> None:
    document = {
        "benchmark": args.benchmark,
        "options": args.set,
        "results": [result.to_json() for result in results],
        **more,
        "versions": versions(),
    }
    print(json.dumps(document, indent=2, allow_nan=False))
