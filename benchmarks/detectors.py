"""How fast corners are detected and filtered: prints the detector table of docs/benchmarks.md."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
from numba import njit
from numpy.typing import NDArray
from provenance import print_provenance
from tqdm import tqdm

from esfo_core.events import EventArray, make_events
from esfo_core.recordings import open_recording
from esfo_frontend.clustering.density_filter import DensityFilter
from esfo_frontend.corners.active_surface import BORDER, INNER_CIRCLE, OUTER_CIRCLE
from esfo_frontend.corners.detector import CornerDetector
from esfo_frontend.options import PRESETS, CornerOptions

GEN4 = Path(__file__).resolve().parents[2] / "shared" / "data" / "raw" / "gen4.dat"
PACKET = 10_000_000
SLICE = 100_000_000
NEVER = np.iinfo(np.int64).min


def moving_rectangles(size: tuple[int, int], rate: float, count: int, spacing: int = 1500) -> EventArray:
    """Return `count` events of a pattern of rectangles that moves obliquely, with 5 % noise, in whole microseconds.

    size: width and height in px; rate: events/s; spacing: px for which there is one rectangle. The pattern moves by one
    pixel at a time; the events that this makes come in random order.
    """
    width, height = size
    rng = np.random.default_rng(1)
    pattern = np.zeros((height + 400, width + 400), np.int8)
    for _ in range(pattern.size // spacing):
        w, h = rng.integers(8, 60, 2)
        x, y = rng.integers(0, pattern.shape[1] - w), rng.integers(0, pattern.shape[0] - h)
        pattern[y : y + h, x : x + w] = rng.integers(0, 2)
    parts, made, t, place = [], 0, 0.0, [0, 0]
    while made < count:
        before = pattern[place[1] : place[1] + height, place[0] : place[0] + width]
        axis = int(len(parts) % 3 == 0)
        place[axis] = (place[axis] + 1) % 400
        change = pattern[place[1] : place[1] + height, place[0] : place[0] + width] - before
        y, x = np.nonzero(change)
        noise = len(x) // 20
        columns = [
            np.append(x, rng.integers(0, width, noise)),
            np.append(y, rng.integers(0, height, noise)),
            np.append(change[y, x] > 0, rng.integers(0, 2, noise)),
        ]
        n = len(columns[0])
        shuffled, duration = rng.permutation(n), n / rate * 1e9
        times = t + np.sort(rng.random(n)) * duration
        parts.append(make_events(*(c[shuffled] for c in columns), times.astype(np.int64) // 1000 * 1000))
        made, t = made + n, t + duration
    return np.concatenate(parts)[:count]


@njit(cache=True, nogil=True)
def plain_has_arc(surface, p, y, x, circle, lengths):  # type: ignore[no-untyped-def]
    """Return whether any arc from any start is newer than the rest, looking at its ends first as the authors do."""
    n = circle.shape[1]
    for start in range(n):
        first = surface[p, y + circle[1, start], x + circle[0, start]]
        if first < surface[p, y + circle[1, start - 1], x + circle[0, start - 1]]:
            continue
        for length in range(lengths[0], lengths[1] + 1):
            end, after = (start + length - 1) % n, (start + length) % n
            if (
                surface[p, y + circle[1, end], x + circle[0, end]]
                < surface[p, y + circle[1, after], x + circle[0, after]]
            ):
                continue
            oldest = first
            for i in range(start + 1, start + length):
                oldest = min(oldest, surface[p, y + circle[1, i % n], x + circle[0, i % n]])
            i = start + length
            while i < start + n and surface[p, y + circle[1, i % n], x + circle[0, i % n]] < oldest:
                i += 1
            if i == start + n:
                return True
    return False


@njit(cache=True, nogil=True)
def plain_efast(events, surface, corner):  # type: ignore[no-untyped-def]
    """EFAST as its definition has it: loops over starts and lengths, on a surface of times in ns."""
    height, width = surface.shape[1:]
    for i in range(len(events)):
        x, y, p = np.int64(events[i].x), np.int64(events[i].y), events[i].p
        surface[p, y, x] = events[i].t
        if x < BORDER or x >= width - BORDER or y < BORDER or y >= height - BORDER:
            continue
        if plain_has_arc(surface, p, y, x, INNER_CIRCLE, (3, 6)):
            corner[i] = plain_has_arc(surface, p, y, x, OUTER_CIRCLE, (4, 8))


def detect_plainly(events: EventArray, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Return the mask (N,) of the corners among the events (N,), from `plain_efast`."""
    corner = np.zeros(len(events), np.bool_)
    plain_efast(events, np.full((2, size[1], size[0]), NEVER, np.int64), corner)
    return corner


def detect_and_filter(events: EventArray, size: tuple[int, int], options: CornerOptions) -> int:
    """Detect and filter in packets of 10 ms and slices of 100 ms; return how many corners were kept."""
    preset = PRESETS["default"]
    detector = CornerDetector(*size, options)
    stage = DensityFilter(*size, preset.time_scale, preset.density)
    first, last = (int(t) for t in events["t"][[0, -1]])
    kept, end = 0, first + SLICE
    for packet in np.split(events, np.searchsorted(events["t"], np.arange(first + PACKET, last, PACKET))):
        stage.add(packet, detector.detect(packet))
        while len(packet) and packet["t"][-1] >= end + stage.reach:
            kept += len(stage.filter_until(end)[0])
            end += SLICE
    return kept + len(stage.filter_until(last + 1)[0])


def seconds(work: Callable[[], object], clock: Callable[[], float], runs: int) -> float:
    """Median time of `work` over `runs` runs."""
    taken = []
    for _ in range(runs):
        begin = clock()
        work()
        taken.append(clock() - begin)
    return median(taken)


def line(name: str, events: EventArray, size: tuple[int, int], runs: int) -> None:
    """Print the row of one stream."""

    def detect(**changes: object) -> NDArray[np.bool_]:
        return CornerDetector(*size, CornerOptions(**changes)).detect(events)  # type: ignore[arg-type]

    corner = detect()
    if not np.array_equal(corner, detect_plainly(events, size)) or not np.array_equal(corner, detect(threads=2)):
        raise SystemExit(f"{name}: eFAST and its plain twin disagree")
    arc_star = detect(detector="arc_star")
    kept = detect_and_filter(events, size, CornerOptions())
    cpu = time.process_time
    plain = seconds(lambda: detect_plainly(events, size), cpu, 1)
    own = seconds(detect, cpu, runs)
    arc = seconds(lambda: detect(detector="arc_star"), cpu, runs)
    both = seconds(lambda: detect_and_filter(events, size, CornerOptions()), cpu, runs)
    one, two = (seconds(lambda n=n: detect(threads=n), time.perf_counter, runs) for n in (1, 2))  # type: ignore[misc]
    speeds = " | ".join(f"{len(events) / s / 1e6:.1f}" for s in (plain, own, arc, both))
    shares = " | ".join(f"{100 * share:.1f}" for share in (corner.mean(), arc_star.mean(), kept / len(events)))
    print(f"| {name} | {speeds} | {plain / own:.1f} | {arc / own:.1f} | {one / two:.2f} | {shares} |", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5, help="runs of which the median is taken")
    parser.add_argument("--events", type=float, default=2.0, help="millions of events of the generated streams")
    arguments = parser.parse_args()
    print_provenance()
    count = int(arguments.events * 1e6)
    streams = {
        "davis": ((240, 180), lambda: moving_rectangles((240, 180), 2e6, count)),
        "hd": ((1280, 720), lambda: moving_rectangles((1280, 720), 26e6, count)),
        "gen4": ((1280, 720), lambda: np.concatenate(list(open_recording(GEN4).chunks()))),
    }
    print("Mev per CPU second; two threads: wall time of one over that of two, valid on idle cores only.\n")
    print(
        "| stream | plain eFAST | eFAST | Arc* | eFAST and density filter | eFAST / plain | eFAST / Arc* "
        "| two threads | corners, % | Arc* corners, % | kept by the filter, % |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for name, (size, events) in tqdm(streams.items(), desc="streams", disable=None, leave=False):
        if name == "gen4" and not GEN4.exists():
            print(f"| gen4 | left out: {GEN4} is not here |")
            continue
        line(name, events(), size, arguments.runs)


if __name__ == "__main__":
    main()
