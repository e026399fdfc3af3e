"""Mutation score of the rooms: `python scripts/mutate.py ROOM|all [COUNT] [--seed N] [--list]`; see CONTRIBUTING.md.

Cosmic Ray makes the mutants. Each one is written into a copy of the project, where the tests of its room run against
it; a mutant that they all pass has survived, and is printed as a diff. COUNT mutants are drawn by the seed; 0 runs all.
"""

from __future__ import annotations

import argparse
import ast
import math
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from difflib import unified_diff
from pathlib import Path

import cosmic_ray.plugins
from cosmic_ray.commands.init import init
from cosmic_ray.mutating import mutate_code
from cosmic_ray.work_db import use_db
from cosmic_ray.work_item import MutationSpec

PROJECT = Path(__file__).resolve().parents[1]
PACKAGES = ("core", "simulation", "ros", "frontend", "backend", "bringup")
NOT_COPIED = shutil.ignore_patterns(".git", ".venv", "build", "install", "log", "__pycache__", "*.nb[ic]", ".*_cache")


@dataclass(frozen=True)
class Room:
    """Sources, and the tests that have to tell a mutant of them, below ros2_ws/src and tests.

    left_out: tests that run the whole pipeline, for minutes.
    """

    sources: tuple[str, ...]
    tests: tuple[str, ...]
    left_out: tuple[str, ...] = ()


def _backend(name: str, *left_out: str) -> Room:
    return Room((f"esfo_backend/esfo_backend/{name}",), (f"backend/{name}",), left_out)


BRINGUP = "esfo_bringup/esfo_bringup"
ROOMS = {
    "spin_rate": _backend("spin_rate", "test_backend_follows_a_changing_rate"),
    "orbit": _backend("orbit"),
    "adjustment": _backend("adjustment"),
    "verdict": _backend("verdict", "test_what_is_no_fixed_axis_at_a_constant_rate_is_named"),
    "landmarks": _backend("landmarks"),
    "initialise": _backend("initialise"),
    "association": Room(("esfo_frontend/esfo_frontend/association",), ("frontend/association",)),
    "cli": Room(
        (f"{BRINGUP}/cli.py", f"{BRINGUP}/commands"),
        ("bringup/test_cli.py", "bringup/test_convert.py", "bringup/test_simulate.py", "bringup/test_benchmark.py"),
    ),
}


class Bench:
    """A copy of the project in which one file at a time is mutated."""

    def __init__(self, folder: Path, room: Room) -> None:
        self.root = folder / "project"
        shutil.copytree(PROJECT, self.root, ignore=NOT_COPIED)
        self._room, self._cache = room, folder / "numba"
        self.limit_s = 1800.0

    def sources(self) -> list[Path]:
        """Files of the room."""
        paths = [self.root / "ros2_ws/src" / source for source in self._room.sources]
        return sorted(f for p in paths for f in ([p] if p.is_file() else p.rglob("*.py")) if f.name != "__init__.py")

    def passes(self, cache: Path) -> bool:
        """Whether all tests of the room pass within the time limit. cache: of compiled code."""
        sources = [str(self.root / f"ros2_ws/src/esfo_{name}") for name in PACKAGES]
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join([*sources, os.environ.get("PYTHONPATH", "")]),
            "PYTHONDONTWRITEBYTECODE": "1",  # two mutants of one second and size would share it
            "NUMBA_CACHE_DIR": str(cache),
        }
        tests = [f"tests/{name}" for name in self._room.tests if (self.root / "tests" / name).exists()]
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
        if self._room.left_out:
            command += ["-k", " and ".join(f"not {name}" for name in self._room.left_out)]
        try:
            run = subprocess.run(
                command, cwd=self.root, env=environment, capture_output=True, timeout=self.limit_s, check=False
            )
        except subprocess.TimeoutExpired:
            return False
        self.output = run.stdout.decode(errors="replace")
        return run.returncode == 0

    def baseline(self) -> None:
        """Run the tests unchanged, which fills the cache; the time limit of a mutant is three times their time."""
        for _ in range(2):
            begin = time.monotonic()
            if not self.passes(self._cache):
                sys.exit(f"the tests of the unchanged room fail:\n{self.output[-3000:]}")
            self.limit_s = 60 + 3 * (time.monotonic() - begin)
            # The second run shows the time with compiled code; a mutant of compiled code compiles everything again.
        self.limit_s += 120

    def survives(self, path: Path, code: str) -> bool:
        """Whether the tests pass with `code` in place of the file."""
        original, stat = path.read_text(), path.stat()
        # Compiled callers in other files hold the code of what they call.
        compiled = "njit" in original
        cache = Path(tempfile.mkdtemp(dir=self.root.parent)) if compiled else self._cache
        try:
            path.write_text(code)
            return self.passes(cache)
        finally:
            path.write_text(original)
            os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))
            if compiled:
                shutil.rmtree(cache)


def mutants(sources: list[Path], folder: Path) -> list[MutationSpec]:
    """All mutants of the files, in a fixed order, without those that cannot change what the program does."""
    with use_db(str(folder / "mutants.sqlite")) as database:
        init(sources, database, {})
        found = [item.mutations[0] for item in database.work_items]
    inert = {path: _inert(path) for path in sources}
    kept = [m for m in found if not any(_within(m, span) for span in inert[m.module_path])]
    return sorted(kept, key=lambda m: (str(m.module_path), m.start_pos, m.operator_name, m.occurrence))


Span = tuple[tuple[int, int], tuple[int, int]]


def _inert(path: Path) -> list[Span]:
    """Annotations, which are not evaluated, `njit` decorators, and blocks for type checkers."""
    spans: list[Span] = []
    for node in ast.walk(ast.parse(path.read_text())):
        parts: list[ast.AST | None] = [getattr(node, "annotation", None), getattr(node, "returns", None)]
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            parts += [d for d in node.decorator_list if "njit" in ast.unparse(d)]
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            parts.append(node)
        for part in parts:
            if isinstance(part, ast.expr | ast.stmt):
                # Cosmic Ray's decorators begin at the @.
                begin = (part.lineno, part.col_offset - 1)
                spans.append((begin, (part.end_lineno or 0, (part.end_col_offset or 0) + 1)))
    return spans


def _within(mutant: MutationSpec, span: Span) -> bool:
    return span[0] <= mutant.start_pos < span[1]


def interval(killed: int, tried: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson)."""
    z, p = 1.96, killed / tried
    middle, width = p + z * z / (2 * tried), z * math.sqrt(p * (1 - p) / tried + z * z / (4 * tried * tried))
    return (middle - width) / (1 + z * z / tried), (middle + width) / (1 + z * z / tried)


def run(name: str, count: int, seed: int, only_list: bool) -> None:
    """Try mutants of one room and print the survivors and the score."""
    with tempfile.TemporaryDirectory(prefix="esfo_mutate_") as folder:
        bench = Bench(Path(folder), ROOMS[name])
        every = mutants(bench.sources(), Path(folder))
        chosen = every if not count or count >= len(every) else random.Random(seed).sample(every, count)
        if not only_list:
            bench.baseline()
        killed = tried = 0
        for k, mutant in enumerate(chosen):
            path = mutant.module_path
            operator = cosmic_ray.plugins.get_operator(mutant.operator_name)(**mutant.operator_args)
            code = mutate_code(path.read_text(), operator, mutant.occurrence)
            where = f"{path.relative_to(bench.root)}:{mutant.start_pos[0]} {mutant.operator_name}"
            if code is None:
                continue
            survived = None if only_list else bench.survives(path, code)
            tried, killed = tried + 1, killed + (survived is False)
            print(f"{k + 1}/{len(chosen)} {'' if survived is None else 'SURVIVED' if survived else 'killed'} {where}")
            if survived is not False:
                lines = (text.splitlines() for text in (path.read_text(), code))
                print("\n".join(d for d in unified_diff(*lines, n=0, lineterm="") if d[:3] not in ("---", "+++")))
            sys.stdout.flush()
        if tried and not only_list:
            low, high = interval(killed, tried)
            print(
                f"| {name} | {len(every)} mutants | {tried} tried | {killed} killed | "
                f"{killed / tried:.0%} ({low:.0%} to {high:.0%}) |",
                flush=True,
            )


def main() -> None:
    """Read the arguments and try the mutants of one room or of all, one after the other."""
    parser = argparse.ArgumentParser(description="Mutation score of the tests of a room.")
    parser.add_argument("room", choices=(*ROOMS, "all"))
    parser.add_argument("count", type=int, nargs="?", default=40, help="mutants to draw; 0: all (default 40)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--list", action="store_true", help="print the mutants without running the tests")
    args = parser.parse_args()
    for name in ROOMS if args.room == "all" else (args.room,):
        run(name, args.count, args.seed, args.list)


if __name__ == "__main__":
    main()
