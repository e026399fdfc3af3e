"""Noise of the pixels in steady light: rates and distributions that can be worked out by hand."""

import numpy as np
import pytest
from known_light import BRIGHTEST, LEVELS, PIXELS, SIZE, film, frame, of_pixel, sensor_for


def dark(seconds, **options):
    sensor = sensor_for(frame(LEVELS.low), **options)
    return film(sensor, [frame(LEVELS.low)] * int(seconds * 10), 1e8)


def test_shot_noise_has_the_rate_and_the_distribution_of_a_poisson_process():
    events = dark(10, shot_hz=5.0)
    expected = 5.0 * PIXELS * 10
    assert len(events) == pytest.approx(expected, abs=4 * np.sqrt(expected))
    assert events["p"].mean() == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(expected))
    per_pixel = np.bincount(events["y"].astype(int) * SIZE[0] + events["x"], minlength=PIXELS)
    assert per_pixel.var() == pytest.approx(50.0, rel=4 * np.sqrt(2 / PIXELS))
    gaps = np.concatenate([np.diff(of_pixel(events, x, y)["t"]) for x, y in np.ndindex(*SIZE)]) / 1e9
    assert np.mean(gaps > np.log(2) / 5.0) == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(len(gaps)) + 0.01)


def test_shot_noise_is_a_quarter_in_bright_light():
    sensor = sensor_for(frame(BRIGHTEST), shot_hz=20.0)
    events = film(sensor, [frame(BRIGHTEST)] * 100, 1e8)
    expected = 5.0 * PIXELS * 10
    assert len(events) == pytest.approx(expected, abs=4 * np.sqrt(expected))


def test_noise_rates_spread_over_the_pixels_about_their_mean():
    events = dark(200, shot_hz=5.0, noise_spread=0.2)
    per_pixel = np.bincount(events["y"].astype(int) * SIZE[0] + events["x"], minlength=PIXELS)
    spread = np.log10(per_pixel).std()
    assert spread == pytest.approx(0.2, rel=4 / np.sqrt(2 * PIXELS) + 0.02)
    sigma = 0.2 * np.log(10)
    assert per_pixel.mean() == pytest.approx(1000, rel=4 * np.sqrt(np.exp(sigma**2) - 1) / np.sqrt(PIXELS))


def test_leak_makes_only_on_events_at_even_intervals():
    events = dark(10, leak_hz=5.0, mismatch=0.1)
    assert events["p"].all()
    assert len(events) == pytest.approx(50 * PIXELS, abs=PIXELS)
    for x, y in np.ndindex(*SIZE):
        assert np.diff(of_pixel(events, x, y)["t"]) == pytest.approx(2e8, abs=1001)


def test_shot_noise_puts_leak_off():
    """Every event resets the pixel: of a leak of period T, disturbed at rate r, r / (exp(r T) - 1) is left."""
    events = dark(40, leak_hz=2.0, shot_hz=4.0)
    expected = 4.0 / (np.exp(4.0 / 2.0) - 1) * PIXELS * 40
    on, off = (events["p"] == 1).sum(), (events["p"] == 0).sum()
    assert on - off == pytest.approx(expected, abs=4 * np.sqrt(on + off))


def test_hot_pixels_are_as_many_and_as_hot_as_asked():
    leaking = dark(10, hot_pixels=0.05, hot_hz=40.0)
    places, counts = np.unique(leaking[["x", "y"]], return_counts=True)
    assert len(places) == round(0.05 * PIXELS)
    assert counts == pytest.approx(400, abs=1)
    assert leaking["p"].all()
    firing = dark(10, hot_pixels=0.05, hot_hz=40.0, hot_kind="shot")
    places, counts = np.unique(firing[["x", "y"]], return_counts=True)
    assert len(places) == round(0.05 * PIXELS)
    assert counts == pytest.approx(400, abs=4 * 20)
    assert firing["p"].mean() == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(len(firing)))
