"""The read-out: a queue with one server, against a plain twin; jitter; what is held and what is lost."""

from collections import deque

import numpy as np
import pytest

from esfo_simulation.sensor.options import SensorOptions
from esfo_simulation.sensor.readout import ReadOut, serve


def slow_queue(requests, service, capacity):
    """Stamps of a queue that is looked at event by event, None for a lost one."""
    waiting, stamps, free = deque(), [], -np.inf
    for t in requests:
        while waiting and waiting[0] <= t:
            waiting.popleft()  # its reading has begun
        if capacity and len(waiting) >= capacity:
            stamps.append(None)
            continue
        begin = max(t, free)
        free = begin + service
        waiting.append(begin)
        stamps.append(begin)
    return stamps


@pytest.mark.parametrize("capacity", [0, 1, 7])
def test_queue_equals_its_twin(capacity):
    rng = np.random.default_rng(2)
    for load in (0.3, 1.0, 3.0):
        # Times that are no multiples of each other, so that no two comparisons are ties.
        requests = np.sort(rng.uniform(0, 400 * 83.3 / load, 400))
        stamps = np.empty(400)
        serve(requests, 83.3, capacity, -np.inf, stamps)
        expected = slow_queue(requests, 83.3, capacity)
        lost = [s is None for s in expected]
        np.testing.assert_array_equal(np.isnan(stamps), lost)
        np.testing.assert_allclose(stamps[~np.isnan(stamps)], [s for s in expected if s is not None])
        if load > 2 and capacity:
            assert any(lost)


def read_out(**options):
    return ReadOut(100, 5_000_000, SensorOptions(**options), np.random.default_rng(1))


def test_saturation_delays_in_order_and_never_reads_faster_than_the_limit():
    requests = np.sort(np.random.default_rng(3).uniform(0, 1e6, 5000))  # 5 Mev/s
    sensor = read_out(readout_mevs=2.0)
    events = np.concatenate([sensor.push(requests, np.arange(5000) * 2, 1e6), sensor.flush()])
    assert len(events) == 5000
    assert sensor.dropped == 0
    t = events["t"]
    assert (np.diff(t) >= 0).all()
    for window_us in (1, 10, 1000):
        starts = np.arange(t[0], t[-1], window_us * 1000)
        counts = np.searchsorted(t, starts + window_us * 1000) - np.searchsorted(t, starts)
        assert counts.max() <= 2.0 * window_us + 1
    # The queue grows by 3 events per us for 1 ms, which take 1.5 ms to be read: so late is the last one.
    assert t[-1] - 5_000_000 == pytest.approx(2.5e6, abs=2e4)
    assert (events["y"].astype(int) * 100 + events["x"] == np.arange(5000)).all()


def test_a_full_queue_drops_and_counts():
    requests = np.sort(np.random.default_rng(3).uniform(0, 1e6, 5000))
    sensor = read_out(readout_mevs=2.0, readout_queue=100)
    events = sensor.push(requests, np.arange(5000) * 2, 1e6)
    assert len(events) + sensor.dropped == 5000
    # 2 Mev/s for 1 ms and what waits at the end; the Poisson scatter lets the server idle only at the beginning.
    assert len(events) == pytest.approx(2000 + 100, abs=40)
    place = events["y"].astype(int) * 100 + events["x"]
    assert (events["t"] - 5_000_000 - requests[place] <= 100 * 500 + 500).all()
    assert (events["t"] - 5_000_000 - requests[place] >= -1000).all()


def test_steps_do_not_matter():
    requests = np.sort(np.random.default_rng(3).uniform(0, 1e6, 3000))
    codes = np.arange(3000) * 2
    options = {"readout_mevs": 2.0, "readout_queue": 50, "jitter_us": 7.0}
    at_once = read_out(**options)
    whole = np.concatenate([at_once.push(requests, codes, 1e6), at_once.flush()])
    by_step = read_out(**options)
    parts = []
    for k in range(10):
        now = (requests >= k * 1e5) & (requests < (k + 1) * 1e5)
        parts.append(by_step.push(requests[now], codes[now], (k + 1) * 1e5))
    np.testing.assert_array_equal(np.concatenate([*parts, by_step.flush()]), whole)
    assert at_once.dropped == by_step.dropped > 0


def test_jitter_has_the_deviation_asked_for_and_keeps_the_order_of_time():
    n = 8000
    requests = np.linspace(0, 1e9, n)
    sensor = read_out(jitter_us=50.0)
    parts = [sensor.push(requests[k : k + 80], np.arange(k, k + 80) * 2, requests[k + 79]) for k in range(0, n, 80)]
    held = sensor.flush()
    events = np.concatenate([*parts, held])
    assert len(held) > 0
    assert (np.diff(events["t"]) >= 0).all()
    place = events["y"].astype(int) * 100 + events["x"]
    shift = events["t"] - 5_000_000 + 500 - requests[place]
    assert shift.mean() == pytest.approx(0, abs=4 * 50e3 / np.sqrt(n))
    assert shift.std() == pytest.approx(50e3, rel=4 / np.sqrt(2 * n))
    assert np.abs(shift).max() <= 4 * 50e3 + 1000


def test_times_are_whole_microseconds_and_never_later_than_the_event():
    sensor = read_out()
    events = sensor.push(np.array([0.0, 999.9, 1000.0, 1500.0]), np.zeros(4, int), 1e6)
    assert (events["t"] - 5_000_000).tolist() == [0, 0, 1000, 1000]
