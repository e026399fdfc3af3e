"""Lamps that flicker: as many events as the swing of the light holds thresholds."""

import numpy as np
import pytest
from known_light import BRIGHTEST, PIXELS, SIZE, film, frame, sensor_for


def test_flicker_makes_the_analytic_number_of_events_also_outside_the_window():
    hz, depth, threshold = 100.0, 0.4, 0.1
    sensor = sensor_for(
        frame(0.0, (4, 5)),
        size=SIZE,
        origin=(3, 2),
        flicker_hz=hz,
        flicker_depth=depth,
        threshold_on=threshold,
        threshold_off=threshold,
    )
    events = film(sensor, [frame(0.0, (4, 5))] * 300, 1e6)
    swing = np.log((1 + depth) / (1 - depth))
    settled = events[events["t"] >= 1e8]
    whole = int(swing / threshold)
    inside = (settled["x"] >= 3) & (settled["x"] < 8) & (settled["y"] >= 2) & (settled["y"] < 6)
    for part in (settled[inside], settled[~inside]):
        _, counts = np.unique(part[["x", "y"]], return_counts=True)
        per_half_period = counts / (2 * hz * 0.2)
        # The reference stands on a lattice of thresholds, of which a swing holds so many or one less, but for one step.
        assert set(np.round(per_half_period, 9)) <= {whole - 1, whole}
        assert part["p"].mean() == pytest.approx(0.5, abs=1e-9)
    _, counts = np.unique(settled[["x", "y"]], return_counts=True)
    mean = counts.sum() / (PIXELS * 2 * hz * 0.2)
    assert mean == pytest.approx(swing / threshold - 1, abs=4 * 0.5 / np.sqrt(PIXELS))


def test_low_pass_takes_flicker_down_alike_inside_and_outside_the_window():
    """At the bandwidth the amplitude is 1 / sqrt(2)."""
    hz = 100.0
    sensor = sensor_for(
        frame(BRIGHTEST, (4, 5)),
        origin=(3, 2),
        flicker_hz=hz,
        flicker_depth=0.4,
        bandwidth_hz=hz,
        threshold_on=0.02,
        threshold_off=0.02,
    )
    events = film(sensor, [frame(BRIGHTEST, (4, 5))] * 300, 1e6)
    settled = events[events["t"] >= 1e8]
    inside = (settled["x"] >= 3) & (settled["x"] < 8) & (settled["y"] >= 2) & (settled["y"] < 6)
    rates = [part.sum() / n for part, n in ((inside, 20), (~inside, PIXELS - 20))]
    assert rates[0] == pytest.approx(rates[1], abs=4 * 0.5 * 40 / np.sqrt(20))
    amplitude = np.log(1.4 / 0.6) / np.sqrt(2)
    assert np.mean(rates) / 40 == pytest.approx(amplitude / 0.02 - 1, rel=0.05)
