"""Time and memory of simulating scenes as files, beside the goals: prints the table of docs/benchmarks.md."""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import tempfile
import time
from pathlib import Path

from provenance import print_provenance

from esfo_core.options import replace
from esfo_simulation.scene import SceneOptions
from esfo_simulation.scene_files import write_scene

SCENES = {
    "1280x720, 3 turns": ({"width": 1280, "height": 720, "revolutions": 3.0, "sensor.threshold_on": 0.45}, 90.0),
    "346x260, 3 turns": ({"width": 346, "height": 260, "revolutions": 3.0}, 15.0),
    "480x360, 2.5 turns": ({}, None),
}
MEMORY_GB = 2.0


def simulate(values: dict[str, object], queue: multiprocessing.Queue[tuple[int, float, float]]) -> None:
    """Write one scene; report events, wall seconds and the peak memory of this process in GB."""
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        truth = write_scene(replace(SceneOptions(), values), Path(folder) / "scene.mcap")
    seconds = time.perf_counter() - begin
    queue.put((truth.events, seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6))


def main() -> None:
    """Print the table, each scene in a process of its own; kernels are compiled before."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-p", dest="set", action="append", default=[], metavar="NAME:=VALUE", help="for every scene")
    extra = dict(text.split(":=", 1) for text in parser.parse_args().set)
    print_provenance()
    context = multiprocessing.get_context("spawn")
    print("| scene | events | s (goal) | peak GB (goal) |\n|---|---|---|---|")
    for name, (values, goal) in {"": ({"revolutions": 0.02}, None), **SCENES}.items():
        queue: multiprocessing.Queue[tuple[int, float, float]] = context.Queue()
        process = context.Process(target=simulate, args=({**values, **extra}, queue))
        process.start()
        events, seconds, memory = queue.get()
        process.join()
        if name:
            asked = f" ({goal:g})" if goal else ""
            print(
                f"| {name} | {events / 1e6:.1f} M | {seconds:.1f}{asked} | {memory:.2f} ({MEMORY_GB:g}) |", flush=True
            )


if __name__ == "__main__":
    main()
