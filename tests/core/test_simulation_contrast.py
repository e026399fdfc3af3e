"""The event model: the compiled kernel against a plain twin, and what a sensor does to known light."""

import numpy as np
import pytest

from esfo_core.simulation.contrast import Sensor, SensorOptions, count_crossings, emit_crossings
from esfo_core.simulation.renderer import Levels

SIZE = (12, 9)
LEVELS = Levels(-60.0, 0.002)


def slow_crossings(frames, span, threshold, refractory, reference, last):
    """One pixel after the other, one crossing after the other, as the definition says."""
    events = []
    for y, x in np.ndindex(*threshold.shape):
        a, b = float(frames[0][y, x]), float(frames[1][y, x])
        c = float(threshold[y, x])
        direction = float(np.sign(b - a))
        while direction != 0 and direction * (b - reference[y, x]) >= c:
            reference[y, x] += direction * c
            t = span[0] + (span[1] - span[0]) * float(np.clip((reference[y, x] - a) / (b - a), 0, 1))
            if t - last[y, x] >= refractory:
                last[y, x] = t
                events.append((x, y, int(direction > 0), int(t)))
    return np.array(events, np.int64).reshape(-1, 4)


@pytest.mark.parametrize("refractory", [0.0, 2e5])
def test_kernel_equals_its_twin(refractory):
    rng = np.random.default_rng(3)
    shape = SIZE[::-1]
    threshold = rng.uniform(0.1, 0.3, shape)
    before = rng.normal(size=shape)
    reference = before + threshold * rng.uniform(-1, 1, shape)
    last = np.full(shape, -np.inf)
    slow_reference, slow_last = reference.copy(), last.copy()
    total = 0
    for k in range(20):
        after = np.where(rng.random(shape) < 0.2, before, before + rng.normal(scale=0.5, size=shape))
        span = (k * 1e6, (k + 1) * 1e6)
        out = np.empty((count_crossings(after, reference, threshold), 4), np.int64)
        n = emit_crossings((before, after), span, threshold, refractory, (reference, last), out)
        expected = slow_crossings((before, after), span, threshold, refractory, slow_reference, slow_last)
        np.testing.assert_array_equal(out[:n], expected)
        np.testing.assert_array_equal(reference, slow_reference)
        np.testing.assert_array_equal(last, slow_last)
        before, total = after, total + n
    assert total > 1000


def frame(log_radiance):
    return np.round((log_radiance - LEVELS.low) / LEVELS.step).astype(np.uint16)


def sensor_for(first, seed=0, **options):
    defaults = {"threshold": 0.25, "mismatch": 0.0, "refractory_us": 0.0, "noise_hz": 0.0}
    return Sensor(
        frame(first), LEVELS, SIZE, (0, 0), SensorOptions(**{**defaults, **options}), np.random.default_rng(seed)
    )


def test_a_ramp_gives_back_the_threshold_of_each_pixel():
    shape = SIZE[::-1]
    rise, seconds = 40.0, 1.0
    sensor = sensor_for(np.zeros(shape), mismatch=0.05)
    steps = 200
    parts = [
        sensor.step(frame(np.full(shape, rise * (k + 1) / steps)), (k * 1e9 / steps, (k + 1) * 1e9 / steps))
        for k in range(steps)
    ]
    events = np.concatenate(parts)
    assert events["p"].all()
    thresholds = []
    for x, y in np.ndindex(*SIZE):
        t = events["t"][(events["x"] == x) & (events["y"] == y)]
        # The interval between events of a steady ramp is threshold / slope; times are cut to 1 us at both ends.
        thresholds.append((t[-1] - t[0]) / (len(t) - 1) * 1e-9 * rise / seconds)
    n = len(thresholds)
    assert np.mean(thresholds) == pytest.approx(0.25, abs=4 * 0.25 * 0.05 / np.sqrt(n))
    assert np.std(thresholds) == pytest.approx(0.25 * 0.05, rel=4 / np.sqrt(2 * n))


def test_light_that_returns_balances_the_polarities():
    shape = SIZE[::-1]
    rng = np.random.default_rng(5)
    amplitude = rng.uniform(-2, 2, shape)
    sensor = sensor_for(np.zeros(shape), mismatch=0.05)
    balance = np.zeros(shape, int)
    count = 0
    for k in range(300):
        step = sensor.step(frame(amplitude * np.sin(2 * np.pi * (k + 1) / 100)), (k * 1e6, (k + 1) * 1e6))
        np.add.at(balance, (step["y"], step["x"]), 2 * step["p"].astype(int) - 1)
        count += len(step)
    assert count > 3000
    # Each pixel ends three whole cycles where it began, so its reference is back within one threshold.
    assert np.abs(balance).max() <= 1


def test_noise_has_the_rate_and_spreads_over_the_sensor():
    first = np.zeros(SIZE[::-1])
    sensor = sensor_for(first, noise_hz=5.0)
    events = np.concatenate([sensor.step(frame(first), (k * 1e8, (k + 1) * 1e8)) for k in range(100)])
    expected = 5.0 * SIZE[0] * SIZE[1] * 10
    assert len(events) == pytest.approx(expected, abs=4 * np.sqrt(expected))
    assert events["p"].mean() == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(expected))
    per_pixel = np.bincount(events["y"].astype(int) * SIZE[0] + events["x"], minlength=SIZE[0] * SIZE[1])
    assert per_pixel.var() == pytest.approx(50.0, rel=4 * np.sqrt(2 / len(per_pixel)))


def test_dead_time_separates_the_events_of_a_pixel():
    shape = SIZE[::-1]
    sensor = sensor_for(np.zeros(shape), refractory_us=500.0)
    events = sensor.step(frame(np.full(shape, 50.0)), (0.0, 1e7))
    for x, y in np.ndindex(*SIZE):
        t = events["t"][(events["x"] == x) & (events["y"] == y)]
        assert len(t) > 5
        # Times are cut to whole microseconds after the dead time was judged.
        assert np.diff(t).min() > 500_000 - 1000


def test_window_is_placed_on_the_sensor():
    sensor = Sensor(
        frame(np.zeros((2, 3))),
        LEVELS,
        (20, 10),
        (7, 5),
        SensorOptions(noise_hz=0.0, mismatch=0.0),
        np.random.default_rng(0),
    )
    events = sensor.step(frame(np.full((2, 3), 1.0)), (0.0, 1e6))
    assert set(events["x"]) == {7, 8, 9}
    assert set(events["y"]) == {5, 6}
    assert (np.diff(events["t"]) >= 0).all()
