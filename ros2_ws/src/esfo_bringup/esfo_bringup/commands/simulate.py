"""`esfo simulate`: a recording of a spinning satellite, with its truth."""

from __future__ import annotations

import argparse
from pathlib import Path

from esfo_bringup.commands.arguments import Commands
from esfo_bringup.commands.reading import add_assignments
from esfo_bringup.errors import CommandError
from esfo_bringup.progress import advance, share_bar
from esfo_core.options import parse_assignments, replace
from esfo_core.simulation.scene import OBJECTS, SPEEDS_HZ, VIEWS, SceneOptions, write_scene


def add_to(commands: Commands[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser("simulate", help="simulate a spinning satellite, with truth")
    default = SceneOptions()
    parser.add_argument("--object", default=default.object, choices=OBJECTS)
    parser.add_argument("--view", default=default.view, choices=VIEWS, help="where the axis points")
    parser.add_argument(
        "--speed", default=default.speed, choices=SPEEDS_HZ, help=", ".join(f"{k} {v} Hz" for k, v in SPEEDS_HZ.items())
    )
    parser.add_argument("--revolutions", type=float, default=default.revolutions, help="turns (default %(default)s)")
    add_assignments(parser, "any other option of the scene")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE.mcap")
    parser.set_defaults(execute=execute)


def execute(args: argparse.Namespace) -> int:
    """Simulate and write recording, truth and mesh."""
    if args.output.suffix != ".mcap":
        raise CommandError(f"{args.output} does not end in .mcap")
    named = {name: getattr(args, name) for name in ("object", "view", "speed", "revolutions")}
    scene = replace(SceneOptions(), {**named, **parse_assignments(args.set)})
    args.output.parent.mkdir(parents=True, exist_ok=True)
    with share_bar("simulating") as bar:
        truth = write_scene(scene, args.output, lambda share: advance(bar, share))
    x, y, z = truth.spin.axis
    print(f"written     {args.output}: {truth.events} events, {truth.revolutions:g} turns")
    print(f"truth       {truth.spin.rate_hz} Hz about ({x:+.4f}, {y:+.4f}, {z:+.4f}), {args.output.stem}.truth.json")
    return 0
