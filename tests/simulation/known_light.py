"""A small sensor without noise of its own, and light that is known, to show to it."""

import numpy as np

from esfo_simulation.render.renderer import Levels
from esfo_simulation.sensor.event_sensor import Sensor
from esfo_simulation.sensor.options import SensorOptions

SIZE = (12, 9)
SHAPE = SIZE[::-1]
PIXELS = SIZE[0] * SIZE[1]
LEVELS = Levels(-5.0, 0.0002)
BRIGHTEST = LEVELS.low + 65535 * LEVELS.step
QUIET = {"mismatch": 0.0, "refractory_us": 0.0, "leak_hz": 0.0, "shot_hz": 0.0, "noise_spread": 0.0}


def frame(log_radiance, shape=SHAPE):
    levels = np.round((np.broadcast_to(log_radiance, shape) - LEVELS.low) / LEVELS.step)
    assert levels.min() >= 0
    assert levels.max() <= 65535
    return levels.astype(np.uint16)


def sensor_for(first, seed=0, size=SIZE, origin=(0, 0), **options):
    chosen = {**QUIET, "threshold_on": 0.25, "threshold_off": 0.25, **options}
    return Sensor(first, LEVELS, size, origin, SensorOptions(**chosen), np.random.default_rng(seed))


def film(sensor, frames, step_ns, begin=0.0):
    """All events while the sensor sees the frames one after the other, step_ns apart."""
    parts = [sensor.step(f, (begin + k * step_ns, begin + (k + 1) * step_ns)) for k, f in enumerate(frames)]
    return np.concatenate([*parts, sensor.flush()])


def of_pixel(events, x, y):
    return events[(events["x"] == x) & (events["y"] == y)]
