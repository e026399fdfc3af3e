"""The back-end on a stream: when the first estimate comes; CPU time of an update, memory and error, turn by turn."""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from provenance import print_provenance

from esfo_backend.backend import Backend
from esfo_backend.options import BackendOptions, MemoryOptions
from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.estimate import OrbitEstimate
from esfo_core.orbit import Spin, angle_between
from esfo_core.tracks import TrackUpdate
from esfo_simulation.activity import synthetic_activity
from esfo_simulation.tracks import SyntheticTrackOptions, synthetic_tracks

RATE_HZ = 0.5
STEP_S = 0.1
BINS = 20
AXIS = np.array([0.3, -0.8, 0.4]) / np.linalg.norm([0.3, -0.8, 0.4])
FIRST_HZ = (0.1, 0.17, 0.5, 2.0, 5.0)


@dataclass(frozen=True)
class Update:
    """One step of 0.1 s: the time at its end, CPU ms, and the estimate if one came."""

    seconds: float
    cpu_ms: float
    estimate: OrbitEstimate | None


def updates(rate_hz: float, duration_s: float, backend: Backend) -> Iterator[Update]:
    """Feed tracks of 100 points (0.5 px of noise, 20 % false ones; 20 rows in 54 degrees) and activity step by step."""
    motion = Spin(AXIS, rate_hz, np.array([0.1, 0.05, 4.0]), 0)
    ball = SyntheticTrackOptions(
        points=100,
        duration_s=duration_s,
        window_s=0.0075 / rate_hz,
        track_s=0.15 / rate_hz,
        noise_px=0.5,
        outliers=0.2,
    )
    scene = synthetic_tracks(motion, backend.camera, ball)
    activity = synthetic_activity(motion, scene.points, backend.camera, duration_s)
    for k in range(round(duration_s / STEP_S)):
        bins = slice(BINS * k, BINS * (k + 1))
        piece = Activity(BINS * k * activity.bin, activity.bin, activity.cell, activity.counts[bins])
        rows = (scene.tracks.t >= piece.t0) & (scene.tracks.t < piece.end)
        begin = time.process_time()
        estimate = backend.update(TrackUpdate(scene.tracks.select(rows), np.empty(0, np.uint32)), piece)
        yield Update(STEP_S * (k + 1), 1e3 * (time.process_time() - begin), estimate)


def first_estimates(camera: Camera) -> None:
    """Print when the first `ok` comes, how good it is, and what happens until six turns are seen."""
    print("| rate, Hz | first `ok`, s after a turn | turns | rate off / std | axis off / std, deg |", end="")
    print(" CPU ms: longest before | median after | longest after | longest wait for an orbit, s | wrong by 4 std |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for rate_hz in FIRST_HZ:
        every = list(updates(rate_hz, max(6 / rate_hz, 4.0), Backend(camera)))
        ok = [u for u in every if u.estimate is not None and u.estimate.status == "ok"]
        if not ok:
            print(f"| {rate_hz} | none | | | | | | | | |")
            continue
        off = np.array([_off(u.estimate, rate_hz) for u in ok if u.estimate is not None])
        first = ok[0].seconds
        after = [u.cpu_ms for u in every if u.seconds > first]
        print(
            f"| {rate_hz} | {first - 1 / rate_hz:.1f} | {first * rate_hz:.2f} | {off[0, 0] / off[0, 1]:.1f} "
            f"| {off[0, 2]:.2f} / {off[0, 3]:.2f} | {max(u.cpu_ms for u in every if u.seconds <= first):.0f} "
            f"| {np.median(after):.0f} | {max(after):.0f} | {np.diff([u.seconds for u in ok]).max():.1f} "
            f"| {np.mean((off[:, 0] > 4 * off[:, 1]) | (off[:, 2] > 4 * off[:, 3])):.0%} of {len(ok)} |",
            flush=True,
        )


def _off(estimate: OrbitEstimate, rate_hz: float) -> tuple[float, float, float, float]:
    """Error and deviation of the rate, Hz, and of the axis, degrees."""
    assert estimate.spin is not None
    rate, axis = abs(estimate.spin.rate_hz - rate_hz), angle_between(estimate.spin.axis, AXIS)
    return rate, estimate.rate_std_hz, axis, estimate.axis_std_deg


def endless(camera: Camera, turns: int) -> None:
    """Print a row every few turns."""
    # Limits that are reached within the stream, so that it shows what happens beyond them.
    backend = Backend(camera, BackendOptions(memory=MemoryOptions(max_bins=8000, max_observations=10_000)))
    spent: list[float] = []
    print("\n| turns | CPU ms per update, median | 95 % | longest | rows bins | peak MiB | rate off | std | axis off |")
    print("|---|---|---|---|---|---|---|---|---|")
    for update in updates(RATE_HZ, turns / RATE_HZ, backend):
        spent.append(update.cpu_ms)
        now, estimate = update.seconds * RATE_HZ, update.estimate
        if estimate is not None and estimate.spin is not None and now % (turns / 8) < STEP_S * RATE_HZ / 2:
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            off = 1e6 * (estimate.spin.rate_hz / RATE_HZ - 1)
            kept = " ".join(str(n) for n in backend.counts())
            print(
                f"| {now:.0f} | {np.median(spent):.0f} | {np.percentile(spent, 95):.0f} | {max(spent):.0f} | {kept} "
                f"| {peak:.0f} | {off:+.1f} ppm | {1e6 * estimate.rate_std_hz / RATE_HZ:.1f} ppm "
                f"| {angle_between(estimate.spin.axis, AXIS):.3f} deg |",
                flush=True,
            )
            spent.clear()
    print(f"\nStream of {turns / RATE_HZ:.0f} s at {RATE_HZ} Hz; 1 ppm = 1e-6 of the rate")


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turns", type=int, default=48, help="of the endless stream; 0 leaves it out")
    turns = parser.parse_args().turns
    print_provenance()
    camera = Camera.pinhole(640, 480, 800.0)
    for _ in updates(2.0, 2.0, Backend(camera)):
        pass  # compiles
    first_estimates(camera)
    if turns:
        endless(camera, turns)


if __name__ == "__main__":
    main()
