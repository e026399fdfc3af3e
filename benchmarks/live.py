"""The back-end on an endless stream: CPU time of an update, memory and error, turn after turn."""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np

from esfo_backend.backend import Backend
from esfo_backend.options import BackendOptions, MemoryOptions
from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.orbit import Spin, angle_between
from esfo_core.simulation.activity import synthetic_activity
from esfo_core.simulation.tracks import SyntheticTrackOptions, synthetic_tracks
from esfo_core.tracks import TrackUpdate

RATE_HZ = 0.5
STEP_S = 0.1
BINS = 20
AXIS = np.array([0.3, -0.8, 0.4]) / np.linalg.norm([0.3, -0.8, 0.4])


def main() -> None:
    """Feed tracks and activity in steps of 0.1 s and print a row every few turns."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turns", type=int, default=48)
    turns = parser.parse_args().turns
    spin, camera = Spin(AXIS, RATE_HZ, np.array([0.1, 0.05, 4.0]), 0), Camera.pinhole(640, 480, 800.0)
    ball = SyntheticTrackOptions(points=100, duration_s=turns / RATE_HZ, noise_px=0.5, outliers=0.2)
    scene = synthetic_tracks(spin, camera, ball)
    activity = synthetic_activity(spin, scene.points, camera, turns / RATE_HZ)
    # Limits that are reached within the stream, so that it shows what happens beyond them.
    backend = Backend(camera, BackendOptions(memory=MemoryOptions(max_bins=8000, max_rows=10_000)))
    spent: list[float] = []
    print("| turns | CPU ms per update, median | 95 % | longest | rows bins | peak MiB | rate off | std | axis off |")
    print("|---|---|---|---|---|---|---|---|---|")
    for k in range(round(turns / RATE_HZ / STEP_S)):
        bins = slice(BINS * k, BINS * (k + 1))
        piece = Activity(BINS * k * activity.bin, activity.bin, activity.cell, activity.counts[bins])
        rows = (scene.tracks.t >= piece.t0) & (scene.tracks.t < piece.end)
        begin = time.process_time()
        estimate = backend.update(TrackUpdate(scene.tracks.select(rows), np.empty(0, np.uint32)), piece)
        spent.append(1e3 * (time.process_time() - begin))
        now = (k + 1) * STEP_S * RATE_HZ
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
    print(f"stream of {turns / RATE_HZ:.0f} s at {RATE_HZ} Hz, {len(scene.tracks)} rows; 1 ppm = 1e-6 of the rate")


if __name__ == "__main__":
    main()
