"""Simulated sensors beside real ones: prints the tables of docs/datasets.md, "Against real recordings".

A real recording and a simulated one never show the same scene, so only what does not hang on the scene compares: noise,
hot pixels, gaps of a pixel, crowding in space and time.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray
from provenance import print_provenance

from esfo_core.errors import EsfoError
from esfo_core.events import EventArray
from esfo_core.recordings import open_recording
from esfo_simulation.scene import SceneOptions, simulate
from esfo_simulation.sensor.catalogue import SENSORS

REAL = {
    "davis240c": ["event_camera_dataset/shapes_rotation/events.txt", "event_camera_dataset/boxes_rotation/events.txt"],
    "davis346": ["raw/davis346.aedat4", "ros_bags/libcaer_cmp_ros2_mcap", "wheel/wheel_11_34_19.aedat4"],
    "gen3": ["raw/evt2.raw", "ros_bags/evt3_ros2_db3"],
    "gen4": ["raw/gen4.dat", "ros_bags/evt3_trigger_ros2_db3"],
}
REVOLUTIONS = {"davis240c": 0.5, "davis346": 0.5, "gen3": 0.15, "gen4": 0.08}
TILE = 16
MOST_EVENTS = 1_500_000
NEAR_NS = 10_000_000
BIN_NS = 10_000_000
HOT_EVENTS, HOT_RATIO = 10, 5


@dataclass(frozen=True)
class Statistics:
    """What can be compared of a recording; rates per pixel in Hz, gaps in ms, shares in per cent."""

    events: int
    seconds: float
    mean_mevs: float
    peak_mevs: float
    noise_hz: float
    noise_median_hz: float
    noise_on: float
    hot_ppm: float
    on: float
    gaps_ms: NDArray[np.float64]
    per_pixel: NDArray[np.float64]
    near: float
    same_us: float
    same_us_row: float


@njit(cache=True)
def count_near(events, size, window_ns):  # type: ignore[no-untyped-def]
    """Count events that one of the 8 neighbours' events precedes by at most window_ns; size: (width, height)."""
    width, height = size
    last = np.full((height + 2, width + 2), -(2**62))
    near = 0
    for event in events:
        x, y, t = event["x"] + 1, event["y"] + 1, event["t"]
        latest = -(2**62)
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                if dx or dy:
                    latest = max(latest, last[y + dy, x + dx])
        near += t - latest <= window_ns
        last[y, x] = t
    return near


def quiet_pixels(counts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Pixels (H, W) of the quarter of tiles, within what fires at all, that fired least."""
    rows, columns = np.flatnonzero(counts.any(axis=1)), np.flatnonzero(counts.any(axis=0))
    tiles = [
        (counts[y : y + TILE, x : x + TILE].sum(), y, x)
        for y in range(rows[0], rows[-1] - TILE + 2, TILE)
        for x in range(columns[0], columns[-1] - TILE + 2, TILE)
    ]
    quiet = np.zeros(counts.shape, bool)
    for _, y, x in sorted(tiles)[: max(len(tiles) // 4, 1)]:
        quiet[y : y + TILE, x : x + TILE] = True
    return quiet


def hot_pixels(counts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Pixels (H, W) that fire far more than any of their neighbours."""
    padded = np.pad(counts, 1)
    shifts = [(dy, dx) for dy in range(3) for dx in range(3) if (dy, dx) != (1, 1)]
    height, width = counts.shape
    around = np.max([padded[dy : dy + height, dx : dx + width] for dy, dx in shifts], axis=0)
    return np.asarray((counts >= HOT_EVENTS) & (counts >= HOT_RATIO * around))


def measure(events: EventArray, size: tuple[int, int]) -> Statistics:
    """Measure events of a sensor `size` (width, height)."""
    place = events["y"].astype(np.int64) * size[0] + events["x"]
    counts = np.bincount(place, minlength=size[0] * size[1]).reshape(size[1], size[0])
    on = np.bincount(place, events["p"], minlength=counts.size).reshape(counts.shape)
    t = events["t"]
    seconds = float(t[-1] - t[0]) / 1e9
    hot = hot_pixels(counts)
    quiet = quiet_pixels(counts) & ~hot
    order = np.lexsort((t, place))
    same_pixel = np.diff(place[order]) == 0
    gaps = np.diff(t[order])[same_pixel] / 1e6
    same_us = np.diff(t // 1000) == 0
    same_row = same_us & (np.diff(events["y"].astype(int)) == 0)
    peak = np.bincount((t - t[0]) // BIN_NS).max() / BIN_NS * 1e3
    return Statistics(
        events=len(events),
        seconds=seconds,
        mean_mevs=len(events) / seconds / 1e6,
        peak_mevs=float(peak),
        noise_hz=float(counts[quiet].mean() / seconds),
        noise_median_hz=float(np.median(counts[quiet]) / seconds),
        noise_on=100 * float(on[quiet].sum() / max(counts[quiet].sum(), 1)),
        hot_ppm=1e6 * float(hot.mean()),
        on=100 * float(events["p"].mean()),
        gaps_ms=np.quantile(gaps, [0.1, 0.5, 0.9]),
        per_pixel=np.quantile(counts[counts > 0], [0.5, 0.9, 0.99]),
        near=100 * count_near(events, size, NEAR_NS) / len(events),
        same_us=100 * float(same_us.mean()),
        same_us_row=100 * float(same_row.mean()),
    )


def take(chunks: Iterator[EventArray]) -> EventArray:
    """Join chunks up to `MOST_EVENTS` events."""
    parts, count = [], 0
    for chunk in chunks:
        parts.append(chunk)
        count += len(chunk)
        if count >= MOST_EVENTS:
            break
    return np.concatenate(parts)


def simulated(name: str) -> EventArray:
    """Return the events of the hubble before a named sensor."""
    model = SENSORS[name]
    options = SceneOptions(
        width=model.width, height=model.height, revolutions=REVOLUTIONS[name], sensor=model.options, speed="medium"
    )
    return take(simulate(options).chunks())


def line(name: str, s: Statistics) -> str:
    """Return the row of a recording."""
    gaps = " / ".join(f"{v:.2f}" for v in s.gaps_ms)
    per_pixel = " / ".join(f"{v:.0f}" for v in s.per_pixel)
    return (
        f"| {name} | {s.events / 1e3:.0f} k, {s.seconds:.2f} s | {s.mean_mevs:.2f}, {s.peak_mevs:.2f} | "
        f"{s.noise_hz:.3f}, {s.noise_median_hz:.2f} | {s.noise_on:.0f} | {s.hot_ppm:.0f} | {s.on:.0f} | "
        f"{gaps} | {per_pixel} | {s.near:.0f} | {s.same_us:.1f} | {s.same_us_row:.2f} |"
    )


def main() -> None:
    """Print one table; each sensor's real recordings, then the simulated one."""
    parser = argparse.ArgumentParser(description=__doc__)
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=default, help="folder of the real recordings")
    data = parser.parse_args().data
    print_provenance()
    print(
        "| recording | events, length | Mev/s mean, peak of 10 ms | noise per pixel, Hz: mean, median | ON of it, % "
        "| hot pixels, ppm | ON, % | gaps of a pixel, ms: 10 / 50 / 90 % "
        "| events of a pixel that fires: 50 / 90 / 99 % "
        "| neighbour within 10 ms, % | same us as the one before, % | and same row, % |"
    )
    print("|" + "---|" * 12)
    for sensor, names in REAL.items():
        for name in names:
            try:
                recording = open_recording(data / name)
                events = take(recording.chunks())
            except EsfoError as error:
                print(f"| {name} | not read: {error} |" + " |" * 10)
                continue
            print(line(f"{sensor}, {name}", measure(events, (recording.width, recording.height))))
        model = SENSORS[sensor]
        print(line(f"**{sensor}, simulated**", measure(simulated(sensor), (model.width, model.height))), flush=True)


if __name__ == "__main__":
    main()
