"""What clustering costs for each corner, how that grows, how near it is to the hdbscan package: two tables."""

from __future__ import annotations

import argparse
import itertools
import math
import resource
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from provenance import print_provenance
from sklearn.metrics import adjusted_rand_score

from esfo_core.events import NS_PER_S, EventArray, make_events
from esfo_core.recordings import open_recording
from esfo_frontend.clustering.chunk_clusterer import ChunkClusterer, cluster
from esfo_frontend.clustering.density_filter import DensityFilter
from esfo_frontend.corners.detector import CornerDetector
from esfo_frontend.options import PRESETS, ClusterOptions, nanoseconds
from esfo_simulation.scene import SceneOptions, simulate

RECORDING = Path(__file__).resolve().parents[2] / "shared" / "data" / "raw" / "gen4.dat"
SCENES = {
    "diagonal, 0.5 Hz": SceneOptions(revolutions=0.5),
    "sideon, 1 Hz": SceneOptions(view="sideon", rate_hz=1.0, revolutions=1.0, seed=3),
    "perpendicular, 0.2 Hz": SceneOptions(view="perpendicular", rate_hz=0.2, revolutions=0.3, seed=2),
}
DEFAULT = PRESETS["default"]
OURS = DEFAULT.clusters
PACKAGE = replace(OURS, algorithm="hdbscan")
COMPARED = 12
"""Chunks of each source that are clustered several times to be compared."""


def kept_corners(events: EventArray, width: int, height: int) -> EventArray:
    """Return the corners of `events` that the density filter keeps."""
    detector = CornerDetector(width, height, DEFAULT.corners)
    density = DensityFilter(width, height, DEFAULT.time_scale, DEFAULT.density)
    ends = np.arange(events["t"][0], events["t"][-1], nanoseconds(OURS.chunk))[1:]
    kept = []
    parts = np.split(events, np.searchsorted(events["t"], ends))
    for part in filter(len, parts):
        density.add(part, detector.detect(part))
        kept.append(density.filter_until(int(part["t"][-1]) - density.reach)[0])
    kept.append(density.filter_until(int(events["t"][-1]) + 1)[0])
    return np.concatenate(kept)


def sources() -> Iterator[tuple[str, EventArray]]:
    """Yield name and corners of the recording, where it is there, and of the simulated scenes."""
    if RECORDING.exists():
        recording = open_recording(RECORDING)
        events = np.concatenate(list(recording.chunks()))
        yield "gen4 recording", kept_corners(events, 1280, 720)
    else:
        print(f"{RECORDING.name} is not there: left out")
    for name, options in SCENES.items():
        events = np.concatenate(list(simulate(options).chunks()))
        yield name, kept_corners(events, options.width, options.height)


def drifting(corners: int, per_ms: float, seed: int = 0) -> EventArray:
    """Return `corners` corner events of 100 points that drift over 640 x 480 px, a tenth of them scattered anywhere."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0, corners / per_ms / 1e3, corners))
    point = rng.integers(0, 100, corners)
    start, velocity = rng.uniform(0, 1, (100, 2)) * [640, 480], rng.normal(0, 100, (100, 2))
    xy = (start[point] + velocity[point] * t[:, None] + rng.normal(0, 0.8, (corners, 2))) % [640, 480]
    anywhere = rng.random(corners) < 0.1
    xy[anywhere] = rng.uniform(0, 1, (int(anywhere.sum()), 2)) * [640, 480]
    return make_events(xy[:, 0], xy[:, 1], np.ones(corners), np.rint(t * 1e9))


def stream(corners: EventArray, options: ClusterOptions) -> float:
    """Cluster corners slice by slice; return the CPU time, us per corner."""
    clusterer = ChunkClusterer(DEFAULT.time_scale, options)
    step = nanoseconds(options.chunk - options.shared)
    ends = np.arange(corners["t"][0] + step, corners["t"][-1] + step + 1, step)
    begin = time.process_time()
    for end, part in zip(ends, np.split(corners, np.searchsorted(corners["t"], ends[:-1])), strict=True):
        clusterer.add_slice(part, int(end))
    clusterer.finish()
    return 1e6 * (time.process_time() - begin) / len(corners)


def agreement(chunk: EventArray) -> tuple[float, float]:
    """Return the adjusted Rand index of ours with the package, and of the package with itself.

    The second is of the same corners in another order: the package breaks ties by the order of its input.
    """
    # Any order will do: the first corner's time is only what the others are counted from.
    order = np.random.default_rng(0).permutation(len(chunk))
    labels: list[NDArray[np.int64]] = [cluster(chunk, DEFAULT.time_scale, o) for o in (OURS, PACKAGE)]
    again = np.empty_like(labels[1])
    again[order] = cluster(chunk[order], DEFAULT.time_scale, PACKAGE)
    return adjusted_rand_score(labels[1], labels[0]), adjusted_rand_score(labels[1], again)


def chunks(corners: EventArray) -> list[EventArray]:
    """Return up to COMPARED chunks with enough corners for a cluster, spread over the recording."""
    t = corners["t"]
    borders = np.arange(t[0], t[-1], nanoseconds(OURS.chunk))
    parts = [p for p in np.split(corners, np.searchsorted(t, borders[1:])) if len(p) > 3 * OURS.min_size]
    return parts[:: max(1, math.ceil(len(parts) / COMPARED))]


def growth(us_per_corner: list[float]) -> float:
    """Exponent p of time ~ corners^p, from the first to the last of a row in which each has ten times the corners."""
    return 1 + math.log10(us_per_corner[-1] / us_per_corner[0]) / (len(us_per_corner) - 1)


def table_of_sources() -> None:
    """Cost and agreement on corners of recordings."""
    print("| corners of | corners | per ms | hdbscan, us per corner | boruvka | ratio | ARI to hdbscan, mean (least) |"
          " hdbscan to itself, mean (least) |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|")
    for name, corners in sources():
        per_ms = len(corners) / (corners["t"][-1] - corners["t"][0]) * NS_PER_S / 1e3
        ours, package = min(stream(corners, OURS) for _ in range(3)), stream(corners, PACKAGE)
        ari, own = np.array([agreement(c) for c in chunks(corners)]).T
        print(f"| {name} | {len(corners)} | {per_ms:.0f} | {package:.1f} | {ours:.2f} | {package / ours:.1f} "
              f"| {ari.mean():.4f} ({ari.min():.4f}) | {own.mean():.4f} ({own.min():.4f}) |")  # fmt: skip


def table_of_growth(largest: int, with_package: bool) -> None:
    """Cost of ten and a hundred times the corners: in a longer stream, in a denser one, and in one chunk."""
    numbers = [10**p for p in range(4, int(math.log10(largest)) + 1)]
    print(f"| drifting points, us per corner | {' | '.join(f'{n:,}' for n in numbers)} | exponent | peak MiB |")
    print("|---|" + "---|" * (len(numbers) + 2))
    whole = replace(OURS, chunk=60_000.0, shared=0.0)
    rows = [
        ("150 per ms, longer and longer", OURS, [150.0] * len(numbers)),
        ("1 s, denser and denser", OURS, [n / 1e3 for n in numbers]),
        ("150 per ms, in one chunk", whole, [150.0] * len(numbers)),
    ]
    for (name, options, rates), algorithm in itertools.product(rows, ("boruvka", "hdbscan")):
        # In one chunk the package takes minutes for a million points.
        if algorithm == "hdbscan" and (not with_package or options is whole):
            continue
        chosen = replace(options, algorithm=algorithm)
        us = [stream(drifting(n, rate), chosen) for n, rate in zip(numbers, rates, strict=True)]
        row = " | ".join(f"{u:.2f}" for u in us)
        print(f"| {name}, {algorithm} | {row} | {growth(us):.2f} | {peak_mib():.0f} |")


def peak_mib() -> float:
    """Peak memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--largest", type=int, default=1_000_000, help="corners of the longest stream")
    parser.add_argument("--with-package", action="store_true", help="let the hdbscan package run the long streams, too")
    arguments = parser.parse_args()
    print_provenance()
    stream(drifting(10_000, 150.0), OURS)  # compiles
    begin = peak_mib()
    table_of_growth(arguments.largest, arguments.with_package)
    print(f"\nPeak memory before the streams: {begin:.0f} MiB\n")
    table_of_sources()
    print(f"\nPeak memory: {peak_mib():.0f} MiB")


if __name__ == "__main__":
    main()
