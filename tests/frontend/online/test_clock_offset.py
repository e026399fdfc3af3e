"""The clock offset against simulated clocks and transport, of which the truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_frontend.online.clock_offset import BUCKET_NS, DRIFT, JUMP_NS, WINDOW_NS, ClockOffset

MS = 1_000_000
S = 1_000_000_000
RATE = 250
"""Packets per second, as drivers send them by default."""


def sensor_times(seconds, rng):
    return np.cumsum(rng.integers(2 * MS, 6 * MS, int(seconds * RATE)))


def feed(clock, t, host):
    return np.array([clock.update(a, b) for a, b in zip(t.tolist(), host.tolist(), strict=True)])


def twin(t, host):
    """The envelope as it is defined, over every packet of the window, without the limit of its fall."""
    t, offset = t.tolist(), (host - t).tolist()  # integers of Python: exact
    return np.array(
        [
            min((DRIFT * offset[j] + t[i] - t[j]) // DRIFT for j in range(i + 1) if t[i] - t[j] <= WINDOW_NS)
            for i in range(len(t))
        ]
    )


def reach_of(jitter_ns, drift, history_s=1.0):
    """Error above which fewer than one estimate in 10^9 lies, ns, for exponential delays of mean `jitter_ns`.

    A packet of age a is off by delay + c a, c = 1 / DRIFT - drift. Packets below e are Poisson distributed: none is
    with probability exp(-n), n = RATE * integral of 1 - exp(-(e - c a) / jitter) over the ages with c a < e.
    """
    c = (1 / DRIFT - drift) * S  # ns per second
    age = np.linspace(0, history_s, 1001)
    errors = np.geomspace(1, 100 * jitter_ns, 400)
    below = [RATE * np.mean(1 - np.exp(-np.maximum(e - c * age, 0) / jitter_ns)) * history_s for e in errors]
    return np.interp(np.log(1e9), below, errors) + c / RATE


@pytest.mark.parametrize("drift", [-1e-4, -3e-5, 0.0, 3e-5, 1e-4])
@pytest.mark.parametrize("jitter", [0.1 * MS, 1 * MS, 10 * MS])
def test_the_truth_is_followed_through_jitter_and_drift(jitter, drift):
    rng = np.random.default_rng(round(jitter + 1e6 * drift) % 2**31)
    t = sensor_times(60, rng)
    truth = 1_700_000_000 * S + np.rint(drift * t).astype(np.int64)
    host = t + truth + rng.exponential(jitter, len(t)).astype(np.int64)
    error = feed(ClockOffset(), t, host) - truth
    settled = error[t > S]
    assert settled.min() >= -1
    assert settled.max() <= reach_of(jitter, drift)
    raw = (host - t - truth)[t > S]
    assert np.abs(settled).mean() < 0.2 * np.abs(raw).mean() + 1


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 4 * S), st.integers(0, JUMP_NS // 4)), min_size=1, max_size=60),
    st.integers(-(2**60), 2**60),
)
def test_it_is_the_envelope_wherever_its_fall_is_not_limited(steps, constant):
    t = np.cumsum([dt + BUCKET_NS for dt, _ in steps])
    host = t + constant + np.array([delay for _, delay in steps])
    clock = ClockOffset()
    values = feed(clock, t, host)
    expected = twin(t, host)
    assert clock.jumps == 0
    assert (values >= expected).all()
    limited = np.concatenate([[False], np.diff(values) == -(np.diff(t) // 2)])
    assert (values == expected)[~limited].all()
    assert (np.diff(t + values) >= 0).all()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(0, 20 * S), min_size=1, max_size=50), st.integers(-(2**61), 2**61))
def test_a_replay_has_exactly_its_offset(steps, constant):
    t = np.cumsum(steps)
    assert (feed(ClockOffset(), t, t + constant) == constant).all()


def test_stamps_never_go_back_inside_a_stream():
    rng = np.random.default_rng(5)
    t = np.cumsum(rng.integers(0, 3 * MS, 20_000))
    host = t + 5 * S + rng.choice([0, 1, 900], len(t), p=[0.1, 0.85, 0.05]) * MS
    clock = ClockOffset()
    stamps = t + feed(clock, t, host)
    assert (np.diff(stamps) >= 0).all()
    assert clock.jumps == 0
    assert stamps[-1] - t[-1] - 5 * S <= 10 * MS


def test_a_step_of_a_clock_below_a_jump_is_followed():
    t = np.arange(0, 40 * S, 4 * MS)
    for step in (300 * MS, -300 * MS):
        host = t + np.where(t > 15 * S, step, 0)
        clock = ClockOffset()
        values = feed(clock, t, host)
        late = t > 15 * S + (WINDOW_NS if step > 0 else 2 * abs(step)) + 8 * MS
        assert (values[late] == step).all()
        assert clock.jumps == 0
        assert (np.diff(t + values) >= 0).all()


@pytest.mark.parametrize("step", [-5 * S, 5 * S, 1_700_000_000 * S])
def test_a_jump_begins_anew_at_once(step):
    t = np.arange(0, 20 * S, 4 * MS)
    host = t + np.where(t > 10 * S, step, 0)
    clock = ClockOffset()
    assert (feed(clock, t, host) == host - t).all()
    assert clock.jumps == 1


def test_a_bag_that_loops_begins_anew_with_its_offset():
    t = np.tile(np.arange(0, 5 * S, 4 * MS), 3)
    clock = ClockOffset()
    assert (feed(clock, t, t + 7 * S) == 7 * S).all()
    assert clock.jumps == 2


def test_late_packets_change_nothing_that_they_should_not():
    clock = ClockOffset()
    for t in (0, 10 * MS, 5 * MS, 12 * MS):
        assert clock.update(t, t + 100) == 100
    assert clock.jumps == 0


def test_reset_forgets():
    clock = ClockOffset()
    clock.update(5, 105)
    clock.reset()
    assert clock.value == 0
    assert clock.update(6, 1006) == 1000


def test_memory_is_bounded_when_every_packet_could_become_the_least():
    clock = ClockOffset()
    t = np.arange(0, 30 * S, MS // 2)
    values = feed(clock, t, t + t // 5000)  # 200 ppm: keys always grow
    assert len(clock._least) <= WINDOW_NS // BUCKET_NS + 2
    assert values[-1] - t[-1] // 5000 <= 1
    assert values[-1] - t[-1] // 5000 >= -WINDOW_NS // DRIFT - 1  # it lags by what the drift exceeds 100 ppm


def test_the_offset_falls_by_no_more_than_half_the_time_that_has_passed():
    clock, offset = ClockOffset(), 3 * S
    assert clock.update(0, offset) == offset
    for k in range(1, 101):  # the host's clock is set back by less than a jump
        before = clock.value
        found = clock.update(k * MS, k * MS + offset - 20 * MS)
        assert found == max(before - MS // 2, offset - 20 * MS)
    assert clock.jumps == 0
    assert found == offset - 20 * MS
