"""What result.mcap costs: `esfo run` with and without it, in turns, on a simulated scene or a recording."""

from __future__ import annotations

import argparse
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from provenance import print_provenance

from esfo_bringup.cli import main as esfo
from esfo_bringup.result_bag.opening import CONTENTS, NAME

ESFO = "from esfo_bringup.cli import console; console()"


def run(recording: Path, content: str, folder: Path) -> tuple[float, float]:
    """Run once in a process of its own; return wall and CPU seconds."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-c", ESFO, "run", str(recording), "-o", str(folder / content), "--bag", content]
    subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print medians and ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", nargs="?", type=Path, help="of which the orbit is found (default: simulated)")
    parser.add_argument("--repeats", type=int, default=3)
    args = parser.parse_args()
    print_provenance()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recording = args.recording
        if recording is None:
            recording = folder / "scene.mcap"
            esfo(["simulate", "-o", str(recording)])
        run(recording, "all", folder)  # compiles, and fills the page cache
        times = {content: [] for content in CONTENTS}
        for _ in range(args.repeats):
            for content in CONTENTS:
                times[content].append(run(recording, content, folder))
        print(f"Recording of {recording.stat().st_size / 1e6:.1f} MB; medians of {args.repeats} runs.\n")
        print("| `--bag` | wall, s | CPU, s | size |\n|---|---|---|---|")
        base = [statistics.median(column) for column in zip(*times["none"], strict=True)]
        for content in CONTENTS:
            wall, cpu = (statistics.median(column) for column in zip(*times[content], strict=True))
            bag = folder / content / NAME
            size = f"{bag.stat().st_size / 1e6:.1f} MB" if bag.exists() else "no bag"
            more = [f"{value:.2f} ({value / least - 1:+.0%})" for value, least in zip((wall, cpu), base, strict=True)]
            print(f"| {content} | {more[0]} | {more[1]} | {size} |")


if __name__ == "__main__":
    main()
