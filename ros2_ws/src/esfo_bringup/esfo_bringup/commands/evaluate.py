"""`esfo evaluate`: compare a result with the truth of a simulation."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import trimesh

from esfo_bringup.commands.arguments import Commands
from esfo_bringup.errors import CommandError
from esfo_core.evaluation.orbit_error import compare, spin_of
from esfo_core.evaluation.registration import MeshSurface, register

T = TypeVar("T")


def add_to(commands: Commands[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = commands.add_parser("evaluate", help="compare a result with the truth")
    parser.add_argument("result", type=Path, metavar="DIR", help="folder that run or live wrote")
    parser.add_argument("--truth", type=Path, required=True, metavar="JSON", help="truth that simulate wrote")
    parser.add_argument("--model", type=Path, metavar="MESH", help="true surface (simulate writes it as .ply)")
    parser.add_argument("--max-rate-error", type=float, metavar="PERCENT", help="fail above this error of the rate")
    parser.add_argument("--max-axis-error", type=float, metavar="DEGREES", help="fail above this error of the axis")
    parser.set_defaults(execute=execute)


def execute(args: argparse.Namespace) -> int:
    """Print estimate, truth and error side by side."""
    orbit, truth = _read(args.result / "orbit.json"), _read(args.truth)
    found = compare(orbit, truth)
    rate_percent = 100 * found.rate_error
    print(f"{'':14}{'estimate':>30}{'truth':>30}{'error':>16}")
    print(f"{'spin rate, Hz':14}{orbit['spin_rate_hz']:>30.6f}{truth['spin_rate_hz']:>30.6f}{rate_percent:>14.4f} %")
    axes = ["({:+.4f}, {:+.4f}, {:+.4f})".format(*d["axis"]) for d in (orbit, truth)]
    print(f"{'axis':14}{axes[0]:>30}{axes[1]:>30}{found.axis_error_deg:>12.3f} deg")
    print(f"status {orbit['status']}, {orbit['points']} points, start {orbit['initialisation']}")
    if args.model is not None:
        _print_registration(args, orbit, truth)
    for name, error, limit in (
        ("rate", abs(rate_percent), args.max_rate_error),
        ("axis", found.axis_error_deg, args.max_axis_error),
    ):
        if limit is not None and not error <= limit:
            raise CommandError(f"the error of the {name} is {error:.4f}, more than {limit:g}")
    return 0


def _print_registration(args: argparse.Namespace, orbit: dict[str, Any], truth: dict[str, Any]) -> None:
    points = _load(args.result / "points.ply", trimesh.PointCloud)
    mesh = _load(args.model, trimesh.Trimesh)
    spins = spin_of(orbit, "estimate"), spin_of(truth, "truth")
    found = register(np.asarray(points.vertices), spins[0], MeshSurface(mesh), spins[1])
    print(
        f"points are {found.mean_percent:.2f} % of the diameter from the surface in the mean, "
        f"{found.median_percent:.2f} % in the median, after registration"
    )


def _load(path: Path, kind: type[T]) -> T:
    try:
        content = trimesh.load(path)
    except (OSError, ValueError, NotImplementedError) as error:
        raise CommandError(f"{path}: cannot be read as geometry ({error})") from error
    if isinstance(content, trimesh.Scene):
        content = content.to_mesh()
    if not isinstance(content, kind):
        raise CommandError(f"{path}: holds a {type(content).__name__}, not a {kind.__name__}")
    return content


def _read(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text())
    except (ValueError, UnicodeDecodeError) as error:
        raise CommandError(f"{path}: not a JSON file ({error})") from error
    if not isinstance(content, dict):
        raise CommandError(f"{path}: not a JSON object")
    return content
