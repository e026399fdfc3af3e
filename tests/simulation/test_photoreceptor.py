"""The closed form of the low pass and of its crossings, against numbers that are found by brute force."""

import numpy as np
import pytest

from esfo_simulation.sensor.photoreceptor import first_crossing, photoreceptor, solve_monotone, time_constants


@pytest.mark.parametrize(("slope", "tau"), [(0.0, 1.0), (2.0, 0.3), (-1.5, 2.0), (0.7, 0.0)])
def test_output_solves_the_differential_equation(slope, tau):
    steps, span = 20_000, 1.7
    light = lambda u: 0.4 + slope * u  # noqa: E731
    v = 0.1
    for k in range(steps):
        middle = light((k + 0.5) * span / steps)
        v = v + (middle - v) * span / steps / tau if tau else light((k + 1) * span / steps)
    assert photoreceptor(0.1, 0.4, slope, tau, span) == pytest.approx(v, abs=2 * span / steps)


def test_first_crossing_equals_a_dense_scan():
    rng = np.random.default_rng(4)
    span, on, off = 1e6, 0.3, 0.2
    u = np.linspace(0, span, 200_001)
    found = {-1: 0, 0: 0, 1: 0}
    after_turn = 0
    for _ in range(400):
        tau = float(rng.choice([0.0, 2e4, 2e5, 3e6]))
        start = rng.uniform(-off, on)
        b = rng.normal(scale=1.0 / span)
        c = rng.normal(scale=0.6) if tau else 0.0
        line = (start - c, b, c)
        curve = line[0] + b * u + (c * np.exp(-u / tau) if tau else 0.0)
        outside = np.flatnonzero((curve >= on) | (curve <= -off))
        time, sign = first_crossing(line, tau, span, on, off)
        expected = 0 if not len(outside) else (1 if curve[outside[0]] >= on else -1)
        assert sign == expected
        found[expected] += 1
        if expected:
            assert u[max(outside[0] - 1, 0)] - 1 <= time <= u[outside[0]] + 1
            after_turn += expected * (curve[1] - curve[0]) < 0
    assert min(found.values()) > 20
    assert after_turn > 5  # some turn back before they cross


def test_root_is_found_to_a_thousandth_of_a_nanosecond():
    tau = 1e5
    root = solve_monotone(-0.5, 0.0, 1.0, tau, (0.0, 1e6))
    assert root == pytest.approx(tau * np.log(2), abs=1e-3)


def test_bandwidth_is_in_proportion_to_the_light():
    white = 2.0
    tau = time_constants(white + np.log(np.array([1.0, 0.5])), white, 100.0)
    assert tau[0] == pytest.approx(1e9 / (2 * np.pi * 100))
    assert tau[0] / tau[1] == pytest.approx((0.5 + 20 / 255) / (1 + 20 / 255))
    assert not time_constants(np.zeros(3), white, 0.0).any()
