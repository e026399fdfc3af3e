"""`esfo simulate`: recordings of spinning objects and of moving cameras, with their truth."""

from __future__ import annotations

import argparse
from pathlib import Path

from tqdm import tqdm

from esfo_bringup.commands.arguments import Commands
from esfo_bringup.commands.reading import add_assignments
from esfo_bringup.errors import CommandError
from esfo_bringup.progress import advance, share_bar
from esfo_core.events import NS_PER_S
from esfo_core.options import parse_assignments, replace
from esfo_simulation.handheld.rooms import ROOMS
from esfo_simulation.handheld.scene import HandheldOptions
from esfo_simulation.objects.catalogue import OBJECTS
from esfo_simulation.scene import SPEEDS_HZ, VIEWS, SceneOptions
from esfo_simulation.scene_files import is_written, topspin, write_handheld, write_scene
from esfo_simulation.sensor.catalogue import SENSORS
from esfo_simulation.truth import Truth

_LONGEST_LENS_MM = 1e4
_NAMED = ("object", "mesh", "view", "speed", "camera", "revolutions")


def add_to(commands: Commands[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser("simulate", help="simulate a spinning object before an event camera, with truth")
    default = SceneOptions()
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--object", choices=OBJECTS, help=f"(default {default.object})")
    what.add_argument("--mesh", metavar="FILE", help="a mesh of your own: .ply, .obj, .glb or .stl, z the spin axis")
    what.add_argument(
        "--topspin",
        action="store_true",
        help="all 72 scenes of the paper into the folder -o; continues where it stopped",
    )
    what.add_argument("--handheld", choices=ROOMS, help="a moving camera, in the form of the Event Camera Dataset")
    parser.add_argument("--view", choices=(*VIEWS, "custom"), help=f"where the axis points (default {default.view})")
    rates = ", ".join(f"{name} {rate} Hz" for name, rate in SPEEDS_HZ.items())
    parser.add_argument("--speed", choices=(*SPEEDS_HZ, "still"), help=f"{rates} (default {default.speed})")
    parser.add_argument("--revolutions", type=float, help=f"turns (default {default.revolutions})")
    parser.add_argument("--sensor", choices=SENSORS, help=f"(default: one of {default.width}x{default.height} px)")
    parser.add_argument("--lens", type=float, default=0.0, metavar="MM", help="focal length of the lens on --sensor")
    parser.add_argument("--camera", metavar="YAML", help="calibration with lens distortion, as ROS writes it")
    add_assignments(parser, "any other option of the scene")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE.mcap", help="or a folder, for several"
    )
    parser.set_defaults(execute=execute)


def execute(args: argparse.Namespace) -> int:
    """Simulate and write recording, truth, mesh and true tracks."""
    if args.handheld:
        return _handheld(args)
    if args.lens and not args.sensor:
        raise CommandError("--lens needs a --sensor")
    if not 0 <= args.lens < _LONGEST_LENS_MM:
        raise CommandError(f"--lens is {args.lens} mm, not within 0 to {_LONGEST_LENS_MM:g}")
    base = SceneOptions.of_sensor(args.sensor, args.lens) if args.sensor else SceneOptions()
    named = {name: getattr(args, name) for name in _NAMED if getattr(args, name) is not None}
    scene = replace(base, {**named, **parse_assignments(args.set)})
    if args.topspin:
        return _topspin(scene, args.output)
    if args.output.suffix != ".mcap":
        raise CommandError(f"{args.output} does not end in .mcap")
    args.output.parent.mkdir(parents=True, exist_ok=True)
    with share_bar("simulating") as bar:
        truth = write_scene(scene, args.output, lambda share: advance(bar, share))
    _say(truth, args.output)
    return 0


def _handheld(args: argparse.Namespace) -> int:
    given = [f"--{name}" for name in (*_NAMED, "sensor") if getattr(args, name) is not None]
    if given:
        raise CommandError(f"{', '.join(given)} cannot be used with --handheld")
    scene = replace(HandheldOptions(), {"scene": args.handheld, **parse_assignments(args.set)})
    with share_bar("simulating") as bar:
        count, lost = write_handheld(scene, args.output, lambda share: advance(bar, share))
    print(f"written     {args.output}: {count} events in {scene.duration_s:g} s{_lost(lost)}")
    print("truth       poses at 200 Hz in groundtruth.txt")
    return 0


def _topspin(base: SceneOptions, folder: Path) -> int:
    """Write those of the 72 scenes that are not written yet."""
    folder.mkdir(parents=True, exist_ok=True)
    every = topspin(base)
    scenes = {name: scene for name, scene in every.items() if not is_written(scene, folder / f"{name}.mcap")}
    with tqdm(total=len(every), initial=len(every) - len(scenes), desc="scenes", unit="", disable=None) as bar:
        for name, scene in scenes.items():
            bar.set_postfix_str(name)
            truth = write_scene(scene, folder / f"{name}.mcap")
            tqdm.write(f"{name}: {truth.events} events")
            bar.update()
    print(f"written     {folder}: {len(every)} scenes")
    return 0


def _say(truth: Truth, path: Path) -> None:
    spin, kind = truth.spin, truth.motion.kind.replace("_", " ")
    x, y, z = spin.axis
    seconds = (truth.span[1] - truth.span[0]) / NS_PER_S
    print(f"written     {path}: {truth.events} events in {seconds:.3f} s{_lost(truth.lost)}")
    print(f"truth       {kind}, {spin.rate_hz} Hz about ({x:+.4f}, {y:+.4f}, {z:+.4f}), {path.stem}.truth.json")


def _lost(events: int) -> str:
    return f", {events} more lost in the read-out" if events else ""
