"""Time of one step of the simulated sensor: prints ms per step, also with every pixel of the window touched.

A disc with a pattern moves by 0.4 px per step in a window of 600x600 on a 1280x720 sensor, as in a scene of `esfo
simulate`: two fifths of the window change in every step.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from provenance import print_provenance
from scipy.ndimage import gaussian_filter, shift

from esfo_simulation.render.renderer import Levels
from esfo_simulation.sensor import event_sensor
from esfo_simulation.sensor.event_sensor import Sensor
from esfo_simulation.sensor.options import SensorOptions

SIZE, WINDOW, ORIGIN = (1280, 720), 600, (300, 60)
LEVELS = Levels(-3.0, 4e-5)
BACKGROUND = 20_000
STEP_NS = 7e5
PLAIN = SensorOptions()
CASES = {
    "plain": PLAIN,
    "plain, every pixel touched": PLAIN,
    "leak, shot noise and hot pixels": replace(PLAIN, leak_hz=1.0, shot_hz=5.0, hot_pixels=1e-3),
    "jitter and read-out": replace(PLAIN, jitter_us=20.0, readout_mevs=10.0),
    "flicker": replace(PLAIN, flicker_hz=100.0, flicker_depth=0.05),
    "bandwidth": replace(PLAIN, bandwidth_hz=1000.0),
    "bandwidth and flicker": replace(PLAIN, bandwidth_hz=1000.0, flicker_hz=100.0, flicker_depth=0.05),
}


def film(frames: int) -> list[NDArray[np.uint16]]:
    """Return frames (600, 600) of levels: there and back again."""
    rng = np.random.default_rng(1)
    pattern = gaussian_filter(rng.normal(size=(WINDOW + 100, WINDOW + 100)), 6)
    pattern = 0.35 * pattern / pattern.std() - 1.5
    y, x = np.mgrid[:WINDOW, :WINDOW] - WINDOW / 2
    disc = np.hypot(x, y) < 0.37 * WINDOW
    there = []
    for k in range(frames):
        moved = shift(pattern, (0, 0.4 * k), order=1)[50 : 50 + WINDOW, 50 : 50 + WINDOW]
        levels = np.where(disc, (moved - LEVELS.low) / LEVELS.step, BACKGROUND)
        there.append(levels.clip(0, 65535).astype(np.uint16))
    return there + there[::-1]


def run(frames: list[NDArray[np.uint16]], options: SensorOptions) -> tuple[float, float]:
    """Return the median CPU time of a step in ms, and events per step."""
    sensor = Sensor(frames[0], LEVELS, SIZE, ORIGIN, options, np.random.default_rng(0))
    times, count = [], 0
    for k, frame in enumerate(frames * 2):
        begin = time.process_time()
        count += len(sensor.step(frame, (k * STEP_NS, (k + 1) * STEP_NS)))
        times.append(time.process_time() - begin)
    return float(np.median(times[2:])) * 1e3, count / len(times)


def main() -> None:
    """Print the table."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    print_provenance()
    frames = film(40)
    mark = event_sensor.mark_active
    results = {}
    for name, options in CASES.items():
        if "every" in name:
            event_sensor.mark_active = lambda band, exposure, active: active.fill(True)
        results[name] = run(frames, options)
        event_sensor.mark_active = mark
    plain = results["plain"][0]
    print("| sensor | ms per step | ratio to plain | events per step |\n|---|---|---|---|")
    for name, (ms, events) in results.items():
        print(f"| {name} | {ms:.2f} | {ms / plain:.1f} | {events:.0f} |")


if __name__ == "__main__":
    main()
