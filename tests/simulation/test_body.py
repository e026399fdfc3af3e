"""Motions of a body: rates, the mechanics of nutation, and the times of frames."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from esfo_core.camera import Camera
from esfo_core.errors import SimulationError
from esfo_core.events import NS_PER_S
from esfo_core.orbit import Spin, object_frame
from esfo_simulation.motion import BodyMotion
from esfo_simulation.simulator import LARGEST_STEP_PX, LONGEST_STEP_NS, frame_times

AXIS = np.array([0.48, -0.6, 0.64])
SPIN = Spin(AXIS, 0.7, np.array([0.01, 0.02, 1.5]), 5_000_000_000)
SECOND = NS_PER_S


def body_rates(motion, t, step=1e4):
    """Angular velocity (3,) in rad/s in the camera frame at t ns, by differences of the pose."""
    before, after = motion.pose(t - step)[0], motion.pose(t + step)[0]
    W = (after - before) @ motion.pose(t)[0].T / (2 * step / SECOND)
    return np.array([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]]) / 2


@given(st.floats(-0.4, 0.4), st.floats(0, 0.59))
def test_time_of_turns_inverts_turns(slope, turns):
    motion = BodyMotion(SPIN, slope_hz_s=slope)
    t = motion.time_of(np.array([turns]))
    # A nanosecond is the last digit of a double at these times, 1e-9 of a turn.
    assert motion.turns(t) == pytest.approx([turns], abs=2e-9)
    assert motion.rate_hz(t) > 0


def test_the_angular_velocity_is_that_of_the_drifting_rate():
    motion = BodyMotion(SPIN, slope_hz_s=0.2)
    for seconds in (0.0, 0.3, 1.7):
        rates = body_rates(motion, SPIN.t0 + seconds * SECOND)
        np.testing.assert_allclose(rates, 2 * np.pi * (0.7 + 0.2 * seconds) * AXIS, atol=1e-4)


@pytest.mark.parametrize("inertia_ratio", [0.4, 0.9, 1.6])
def test_a_nutating_body_keeps_its_angular_momentum(inertia_ratio):
    nutation = np.radians(25)
    motion = BodyMotion(SPIN, nutation_rad=nutation, inertia_ratio=inertia_ratio)
    momenta = []
    for t in SPIN.t0 + np.linspace(0, 2, 9) * SECOND:
        R, _ = motion.pose(t)
        own = R @ AXIS
        assert own @ AXIS == pytest.approx(np.cos(nutation))
        across = np.eye(3) - np.outer(own, own)
        momenta.append((across + inertia_ratio * np.outer(own, own)) @ body_rates(motion, t))
    # Moments of inertia 1 across: the momentum is the precession rate times 1, along the fixed axis.
    np.testing.assert_allclose(momenta, np.tile(2 * np.pi * 0.7 * AXIS, (9, 1)), atol=1e-4)


def test_a_translating_body_moves_on():
    motion = BodyMotion(SPIN, velocity=np.array([0.1, 0, -0.2]))
    _, T = motion.pose(SPIN.t0 + 2 * SECOND)
    np.testing.assert_allclose(T, SPIN.center + np.array([0.2, 0, -0.4]))


def test_kinds_and_what_repeats():
    drifting = BodyMotion(SPIN, slope_hz_s=0.1)
    nutating = BodyMotion(SPIN, slope_hz_s=0.1, nutation_rad=0.2)
    translating = BodyMotion(SPIN, velocity=np.array([0.1, 0, 0]))
    still = BodyMotion(Spin(AXIS, 0.0, SPIN.center, 0))
    kinds = [m.kind for m in (BodyMotion(SPIN), drifting, nutating, translating)]
    assert kinds == ["fixed_axis", "drifting_rate", "nutating", "translating"]
    assert [m.repeats for m in (drifting, nutating, translating, still)] == [True, False, False, False]


def test_a_rate_that_ends_is_refused():
    with pytest.raises(SimulationError, match=r"-?0\.2 Hz/s ends after 1\.225 turns"):
        BodyMotion(SPIN, slope_hz_s=-0.2).time_of(np.array([1.3]))


@pytest.mark.parametrize("velocity", [np.zeros(3), np.array([0.2, 0.1, 0.3])])
def test_frame_times_bound_the_motion(velocity):
    motion = BodyMotion(SPIN, nutation_rad=0.3, velocity=velocity)
    camera = Camera.pinhole(640, 480, 800.0)
    vertices = np.random.default_rng(2).normal(scale=0.1, size=(40, 3)) @ object_frame(AXIS).T
    span = (5.0 * SECOND, 6.0 * SECOND)
    times, bounds = frame_times(motion, vertices, camera, span, 721)
    assert (times[0], times[-1]) == span
    uv = np.array([camera.project(vertices @ R.T + T) for R, T in map(motion.pose, times)])
    steps = np.linalg.norm(np.diff(uv, axis=0), axis=2).max(axis=1)
    assert steps.max() <= LARGEST_STEP_PX * 1.01
    assert np.median(steps) > 0.8 * LARGEST_STEP_PX  # no more frames than it takes
    assert (bounds[0] <= uv.min(axis=(0, 1)) + 0.01).all()
    assert (bounds[1] >= uv.max(axis=(0, 1)) - 0.01).all()


def test_frames_of_what_stands_still_are_not_too_rare():
    motion = BodyMotion(Spin(AXIS, 0.0, SPIN.center, 0))
    times, _ = frame_times(motion, np.eye(3) * 0.1, Camera.pinhole(64, 48, 80.0), (0.0, SECOND), 100)
    assert np.diff(times).max() <= LONGEST_STEP_NS * 1.001
    assert len(times) == pytest.approx(SECOND / LONGEST_STEP_NS, abs=2)
