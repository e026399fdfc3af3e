"""What a sensor does to light that is known: thresholds, rates and times that can be worked out by hand."""

import numpy as np
import pytest
from known_light import BRIGHTEST, LEVELS, PIXELS, SHAPE, SIZE, film, frame, of_pixel, sensor_for

from esfo_core.errors import OptionError, SimulationError


@pytest.mark.parametrize("polarity", [0, 1])
def test_a_ramp_gives_back_the_threshold_of_each_pixel(polarity):
    rise, steps, step_ns = 6.0, 200, 5e6
    ramp = [rise * (k + 1) / steps * (1 if polarity else -1) + (0 if polarity else 6) - 4 for k in range(steps)]
    first = -4.0 if polarity else 2.0
    sensor = sensor_for(frame(first), mismatch=0.05, threshold_on=0.25, threshold_off=0.1)
    events = film(sensor, [frame(v) for v in ramp], step_ns)
    assert (events["p"] == polarity).all()
    nominal = 0.25 if polarity else 0.1
    thresholds = []
    for x, y in np.ndindex(*SIZE):
        t = of_pixel(events, x, y)["t"]
        # The interval between events of a steady ramp is threshold / slope.
        thresholds.append((t[-1] - t[0]) / (len(t) - 1) * rise / (steps * step_ns))
    assert np.mean(thresholds) == pytest.approx(nominal, abs=4 * nominal * 0.05 / np.sqrt(PIXELS))
    assert np.std(thresholds) == pytest.approx(nominal * 0.05, rel=4 / np.sqrt(2 * PIXELS))


def test_thresholds_of_both_polarities_scatter_independently():
    sensor = sensor_for(frame(0.0), mismatch=0.1)
    there, back = [4.0 * k / 100 for k in range(1, 101)], [4.0 - 4.0 * k / 100 for k in range(1, 101)]
    events = film(sensor, [frame(v) for v in there + back], 1e6)
    counts = [[(of_pixel(events, x, y)["p"] == p).sum() for p in (0, 1)] for x, y in np.ndindex(*SIZE)]
    assert abs(np.corrcoef(np.transpose(counts))[0, 1]) < 4 / np.sqrt(PIXELS)


def test_moving_edges_make_the_analytic_rate():
    """Edges of log contrast C that cross the sensor at v px/s make v H C / threshold events per second."""
    height, width, contrast, threshold, v, step_ns = 9, 120, 1.1, 0.25, 1000.0, 2.5e5
    columns = np.arange(width)

    def picture(t):
        # Two rising edges of 3 px, so that before the second one every pixel's last event is ON.
        edges = [np.clip((v * t * 1e-9 - columns - offset) / 3.0, 0, 1) for offset in (0, 150)]
        return frame(-2.0 + contrast * (edges[0] + edges[1]), (height, width))

    sensor = sensor_for(picture(0.0), size=(width, height), threshold_on=threshold)
    events = film(sensor, [picture((k + 1) * step_ns) for k in range(1150)], step_ns)
    second = events[events["t"] >= 0.150e9 + (events["x"].astype(float) - 1) / v * 1e9]
    assert second["p"].all()
    counts = np.bincount(second["y"].astype(int) * width + second["x"], minlength=width * height)
    assert set(counts) == {int(contrast / threshold), int(contrast / threshold) + 1}
    share = contrast / threshold - int(contrast / threshold)
    assert np.mean(counts - int(contrast / threshold)) == pytest.approx(share, abs=4 * 0.5 / np.sqrt(len(counts)))
    steady = second[(second["t"] > 0.16e9) & (second["t"] < 0.26e9)]
    rate = v * height * contrast / threshold
    # Within 100 ms the edge crosses 900 pixels, each of which makes one more or one less.
    assert len(steady) / 0.1 == pytest.approx(rate, abs=4 * 0.5 * np.sqrt(900) / 0.1)


def test_light_that_returns_balances_the_polarities():
    amplitude = np.random.default_rng(5).uniform(-2, 2, SHAPE)
    sensor = sensor_for(frame(0.0), mismatch=0.05, threshold_on=0.2, threshold_off=0.2)
    events = film(sensor, [frame(amplitude * np.sin(2 * np.pi * (k + 1) / 100)) for k in range(300)], 1e6)
    assert len(events) > 3000
    for x, y in np.ndindex(*SIZE):
        mine = of_pixel(events, x, y)
        # Three whole cycles: ON steps and OFF steps of this pixel's own sizes lead back to within one of them.
        on, off = (mine["p"] == 1).sum(), (mine["p"] == 0).sum()
        assert abs(on - off) <= 0.25 * max(on, off) + 1
    assert events["p"].mean() == pytest.approx(0.5, abs=4 * 0.05 / np.sqrt(PIXELS) + PIXELS / len(events))


def test_dead_time_separates_the_events_of_a_pixel_and_forgets_what_passes():
    slope, steps = 1e3, 50  # log intensity per s
    for dead_us in (0.0, 500.0):
        sensor = sensor_for(frame(-4.0), refractory_us=dead_us)
        events = film(sensor, [frame(-4.0 + slope * 2e-4 * (k + 1)) for k in range(steps)], 2e5)
        for x, y in np.ndindex(*SIZE):
            # After the dead time, the light must move by a whole threshold again.
            gaps = np.diff(of_pixel(events, x, y)["t"])
            assert len(gaps) > 5
            assert gaps == pytest.approx(0.25 / slope * 1e9 + dead_us * 1e3, abs=2001)


@pytest.mark.parametrize("light", [BRIGHTEST, BRIGHTEST - 1.5])
def test_step_response_gives_back_the_time_constant(light):
    hz, contrast = 100.0, 4.0
    sensor = sensor_for(frame(light - contrast), bandwidth_hz=hz, threshold_on=0.2)
    events = film(sensor, [frame(light)] + [frame(light)] * 50, 1e6)
    assert events["p"].all()
    radiance = np.exp(light - BRIGHTEST)
    expected = 1e9 / (2 * np.pi * hz) * (1 + 20 / 255) / (radiance + 20 / 255)
    for x, y in np.ndindex(*SIZE):
        t = of_pixel(events, x, y)["t"].astype(float)
        late = t[t > 1e6]
        low, high = 0.1 * expected, 10 * expected
        while high - low > 1e-4 * expected:
            middle = 0.5 * (low + high)
            # Of V = L - C exp(-t / tau), events fall where the exponential has gone down by equal steps.
            first, second, last = np.exp(-late[[0, 1, -1]] / middle)
            low, high = (middle, high) if (first - last) / (first - second) < len(late) - 1 else (low, middle)
        # Stamps are cut to 1 us; the first interval is the shortest and carries that error.
        assert middle == pytest.approx(expected, rel=4 * 1e3 / (late[1] - late[0]) + 1e-3)


def test_cutting_a_step_in_two_changes_nothing():
    options = {"leak_hz": 200.0, "refractory_us": 300.0, "flicker_hz": 90.0, "flicker_depth": 0.2, "mismatch": 0.1}
    end = np.linspace(1.0, 3.0, PIXELS).reshape(SHAPE)
    whole = film(sensor_for(frame(0.0), **options), [frame(end)], 3e7)
    parts = film(sensor_for(frame(0.0), **options), [frame(end * (k + 1) / 10) for k in range(10)], 3e6)
    assert len(whole) > 1000
    key = ["y", "x", "t"]
    whole, parts = np.sort(whole, order=key), np.sort(parts, order=key)
    np.testing.assert_array_equal(whole[["x", "y", "p"]], parts[["x", "y", "p"]])
    # Levels of the frames in between are rounded, which moves crossings by a level over the slope.
    assert np.abs(whole["t"] - parts["t"]).max() <= 1000 + 2 * LEVELS.step / (1.0 / 3e7)


def test_window_is_placed_on_the_sensor_and_the_rest_sees_constant_light():
    sensor = sensor_for(frame(0.0, (2, 3)), size=(20, 10), origin=(7, 5))
    events = sensor.step(frame(1.0, (2, 3)), (0.0, 1e6))
    assert set(events["x"]) == {7, 8, 9}
    assert set(events["y"]) == {5, 6}
    noisy = sensor_for(frame(0.0, (2, 3)), size=(20, 10), origin=(7, 5), leak_hz=10.0)
    events = film(noisy, [frame(0.0, (2, 3))] * 20, 1e7)
    _, counts = np.unique(events[["x", "y"]], return_counts=True)
    assert counts.tolist() == pytest.approx([2] * 200, abs=1)
    assert len(counts) == 200


EVERYTHING = {
    "mismatch": 0.1,
    "refractory_us": 50.0,
    "bandwidth_hz": 300.0,
    "leak_hz": 5.0,
    "shot_hz": 5.0,
    "noise_spread": 0.2,
    "hot_pixels": 0.05,
    "jitter_us": 20.0,
    "readout_mevs": 0.004,
    "readout_queue": 20,
    "flicker_hz": 100.0,
    "flicker_depth": 0.3,
}


def test_same_seed_same_bytes_and_in_order_of_time():
    wave = [frame(np.sin(k / 5.0) + np.linspace(-1, 1, 20).reshape(4, 5), (4, 5)) for k in range(200)]
    runs = []
    for seed in (3, 3, 4):
        sensor = sensor_for(wave[0], seed, origin=(3, 2), **EVERYTHING)
        runs.append((film(sensor, wave[1:], 1e6, begin=7e9), sensor.dropped))
    assert runs[0][0].tobytes() == runs[1][0].tobytes()
    assert runs[0][1] == runs[1][1] > 0
    assert runs[0][0].tobytes() != runs[2][0].tobytes()
    assert (np.diff(runs[0][0]["t"]) >= 0).all()
    assert len(runs[0][0]) > 500


def test_what_makes_no_sense_is_refused():
    with pytest.raises(OptionError, match=r"0\.0"):
        sensor_for(frame(0.0), threshold_on=0.0)
    with pytest.raises(SimulationError, match="12x9"):
        sensor_for(frame(0.0), origin=(1, 0))
    sensor = sensor_for(frame(0.0))
    with pytest.raises(SimulationError, match="no step"):
        sensor.flush()
    sensor.step(frame(0.0), (0.0, 1e6))
    with pytest.raises(SimulationError, match="2000000"):
        sensor.step(frame(0.0), (2e6, 3e6))
    with pytest.raises(SimulationError, match="4, 5"):
        sensor.step(frame(0.0, (4, 5)), (1e6, 2e6))
