"""The rate from the event stream alone, from 0.005 to 1000 Hz, and what is said of recordings without a rotation.

Scenes are simulated once, at 1 Hz and without noise, and re-clocked: events of a scene without dead time, noise and
read-out limit are the same at any rate but for their times. Noise, dead time, jitter and read-out limit of the sensor
are then put on, in real time. The loops of real wheels are re-clocked as they are.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numba import njit

from esfo_backend.spin_rate.stream_rate import NoRateError, StreamRate, stream_rate
from esfo_core.activity_pyramid import ActivityPyramid
from esfo_core.errors import EsfoError
from esfo_core.events import EventArray, make_events
from esfo_core.pyramid_counter import PyramidCounter
from esfo_core.recordings.opening import open_recording
from esfo_simulation.scene import SceneOptions, simulate
from esfo_simulation.sensor.catalogue import sensor_model
from esfo_simulation.sensor.options import SensorOptions

RATES_HZ = (0.005, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
OBJECTS = (("hubble", "diagonal"), ("camera", "sideon"), ("tdrs", "topdown"))
SENSORS = ("davis240c", "gen3")
SHARED = Path(__file__).parents[1].parent / "shared/data"
NO_ROTATION = (
    "raw/gen4.dat",
    "raw/evt2.raw",
    "raw/davis346.aedat4",
    "ros_bags/evt3_ros1.bag",
    "ros_bags/libcaer_cmp_ros2_mcap",
    "ros_bags/libcaer_rollover_ros2_db3",
    "ros_bags/evt3_trigger_ros2_db3",
    "event_camera_dataset/shapes_rotation/events.txt",
    "event_camera_dataset/poster_rotation/events.txt",
    "event_camera_dataset/boxes_rotation/events.txt",
    "wheel/wheel_11_34_19.aedat4",
    "wheel/wheel_11_34_58.aedat4",
    "wheel/wheel_11_35_12.aedat4",
    "wheel/wheel_11_35_33.aedat4",
    "wheel/wheel_11_36_31.aedat4",
)


@dataclass(frozen=True)
class Case:
    """A stream of events from a sensor of width x height px that turns at rate_hz."""

    name: str
    rate_hz: float
    width: int
    height: int
    events: EventArray


def rate_of(events: EventArray, width: int, height: int) -> StreamRate:
    """As the front-end and the back-end find it, in packets."""
    counter, pyramid = PyramidCounter(width, height), ActivityPyramid()
    for first in range(0, len(events), 50_000):
        counter.add(events[first : first + 50_000])
        pyramid.add(counter.take())
    counter.finish()
    pyramid.add(counter.take())
    return stream_rate(pyramid.levels())


def scenes(rates: tuple[float, ...], scale: float) -> Iterator[Case]:
    """Simulated scenes; scale: of the image, to save time."""
    for sensor_name in SENSORS:
        sensor = sensor_model(sensor_name)
        size = round(sensor.width * scale), round(sensor.height * scale)
        clean = replace(sensor.options, refractory_us=0.0, bandwidth_hz=0.0, leak_hz=0.0, shot_hz=0.0, hot_pixels=0.0)
        clean = replace(clean, jitter_us=0.0, readout_mevs=0.0)
        for name, view in OBJECTS:
            options = SceneOptions(object=name, view=view, rate_hz=1.0, revolutions=2.6, sensor=clean)
            scene = simulate(replace(options, width=size[0], height=size[1]))
            events = np.concatenate(list(scene.chunks()))
            for rate_hz in rates:
                seen = as_seen(events, rate_hz, sensor.options, size)
                yield Case(f"{sensor_name} {name}", rate_hz, *size, seen)


def as_seen(events: EventArray, rate_hz: float, sensor: SensorOptions, size: tuple[int, int]) -> EventArray:
    """Events of 1 Hz at another rate, with noise, jitter, dead time and read-out limit in real time."""
    rng = np.random.default_rng(round(1000 * rate_hz))
    t = (events["t"] - events["t"][0]) / rate_hz
    duration = t[-1] / 1e9
    n = rng.poisson((sensor.leak_hz + sensor.shot_hz) * size[0] * size[1] * duration)
    noise = make_events(
        rng.integers(0, size[0], n),
        rng.integers(0, size[1], n),
        rng.random(n) < (sensor.leak_hz + sensor.shot_hz / 2) / max(sensor.leak_hz + sensor.shot_hz, 1e-9),
        (rng.random(n) * duration * 1e9).astype(np.int64),
    )
    moved = events.copy()
    moved["t"] = t + rng.normal(0, 1, len(t)) * sensor.jitter_us * 1e3
    merged = np.concatenate([moved, noise])
    merged = merged[np.argsort(merged["t"], kind="stable")]
    merged["t"] += 1_000_000_000
    pixel = merged["y"].astype(np.int64) * size[0] + merged["x"]
    merged = merged[_alive(merged["t"], pixel, size[0] * size[1], round(sensor.refractory_us * 1e3))]
    limit = sensor.readout_mevs * 1e6 * duration
    return merged[rng.random(len(merged)) < limit / len(merged)] if 0 < limit < len(merged) else merged


@njit(cache=True)
def _alive(t, pixel, pixels, dead_ns):  # type: ignore[no-untyped-def]
    latest = np.full(pixels, -(10**18))
    kept = np.zeros(len(t), np.bool_)
    for i in range(len(t)):
        if t[i] - latest[pixel[i]] >= dead_ns:
            kept[i], latest[pixel[i]] = True, t[i]
    return kept


def wheels(rates: tuple[float, ...]) -> Iterator[Case]:
    """The loops of real wheels."""
    for path in sorted((SHARED / "wheel_loops").glob("disc_*.csv.gz")):
        true_hz = float(path.name.split("_")[1].split("hz")[0])
        with gzip.open(path, "rt") as file:
            unit = 1000 if next(csv.reader(file))[0] == "t_us" else 1
            t, x, y, p = np.loadtxt(file, np.int64, delimiter=",").T
        for rate_hz in rates:
            yield Case(
                path.name[:-7],
                rate_hz,
                346,
                260,
                make_events(x, y, p, (t * unit * (true_hz / rate_hz)).astype(np.int64)),
            )


def run(cases: Iterator[Case], each: bool) -> None:
    """Print how each case comes out, or those that are not right, and the shares."""
    right = wrong = total = 0
    pulls: list[float] = []
    seconds = 0.0
    for case in cases:
        begin = time.process_time()
        try:
            found = rate_of(case.events, case.width, case.height)
            pull = (found.rate_hz - case.rate_hz) / found.rate_std_hz
            text = (
                f"{found.rate_hz:.6g} +- {found.rate_std_hz:.2g} Hz, {pull:+.1f} deviations, r {found.correlation:.3f}"
            )
            # A thousandth of the rate is no other rate, whatever the deviation says.
            off = abs(found.rate_hz / case.rate_hz - 1)
            bad = abs(pull) > 3 and off > 1e-3
            pulls.append(pull)
        except NoRateError as error:
            text, bad, pull = f"{error.reason}: {error}", False, np.inf
        seconds += time.process_time() - begin
        total, wrong, right = total + 1, wrong + bad, right + (abs(pull) <= 3)
        if each or bad or abs(pull) > 3:
            print(
                f"  {case.name:32} {case.rate_hz:8.3f} Hz {len(case.events):9} events: {'WRONG ' * bad}{text}",
                flush=True,
            )
    rms = np.sqrt(np.mean(np.square(pulls))) if pulls else np.nan
    print(
        f"{right} of {total} right within 3 deviations, {wrong} wrong, {total - len(pulls)} without a rate; "
        f"RMS of the pulls {rms:.2f}; {seconds / max(total, 1):.2f} s of CPU each"
    )


def without_rotation() -> None:
    """Print what is said of recordings that hold no rotation at a constant rate."""
    for name in NO_ROTATION:
        try:
            recording = open_recording(SHARED / name)
            events = np.concatenate(list(recording.chunks()))
        except EsfoError as error:
            print(f"  {name:50} cannot be read: {error}")
            continue
        try:
            found = rate_of(events, recording.width, recording.height)
            text = f"A RATE: {found.rate_hz:.5g} +- {found.rate_std_hz:.2g} Hz, r {found.correlation:.3f}"
        except NoRateError as error:
            text = f"{error.reason}: {error}"
        print(f"  {name:50} {text}", flush=True)


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--all", action="store_true", help="full resolution, and every case printed")
    parser.add_argument("--only", choices=("scenes", "wheels", "none"), help="one part")
    args = parser.parse_args()
    if args.only in (None, "scenes"):
        print("scenes")
        run(scenes(RATES_HZ, 1.0 if args.all else 0.5), args.all)
    if args.only in (None, "wheels"):
        print("wheels")
        run(wheels(RATES_HZ if args.all else RATES_HZ[::3]), args.all)
    if args.only in (None, "none"):
        print("no rotation")
        without_rotation()


if __name__ == "__main__":
    main()
