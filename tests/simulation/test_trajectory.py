"""The motion of a hand-held camera: smooth, within reach, and as fast as in the dataset."""

from __future__ import annotations

import numpy as np
import pytest
from recording_truth import recording
from scipy.spatial.transform import Rotation

from esfo_simulation.handheld.trajectory import FORWARD, MOTIONS, REACH_M, REACH_RAD, random_trajectory

SECOND = 10**9
MINUTE = (SECOND, 61 * SECOND)


def speeds(trajectory, t):
    """Speed (N - 1,) in m/s and rad/s between successive times, ns."""
    position, orientation = trajectory.camera_poses(t)
    turned = (Rotation.from_quat(orientation[:-1]).inv() * Rotation.from_quat(orientation[1:])).magnitude()
    seconds = np.diff(t) / SECOND
    return np.linalg.norm(np.diff(position, axis=0), axis=1) / seconds, turned / seconds


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_trajectory_is_smooth_and_within_reach(motion):
    trajectory = random_trajectory(motion, MINUTE, 5)
    t = np.arange(*MINUTE, SECOND // 1000)
    position, orientation = trajectory.camera_poses(t)
    np.testing.assert_allclose(np.linalg.norm(orientation, axis=1), 1, atol=1e-14)
    assert (np.abs(position) <= REACH_M).all()
    resting = Rotation.from_matrix(FORWARD)
    assert (np.abs((resting.inv() * Rotation.from_quat(orientation)).as_rotvec()) <= REACH_RAD).all()
    # |x''| <= sum of A (2 pi f pace)^2 + A 2 pi f growth: a jump or a kink would exceed it by orders of magnitude.
    start, growth = trajectory.pace
    rate = 2 * np.pi * trajectory.frequency * (start + 60 * growth)
    bound = (trajectory.amplitude * (rate**2 + 2 * np.pi * trajectory.frequency * growth)).sum(axis=1)
    second = np.diff(position, 2, axis=0) * 1e6
    assert (np.abs(second).max(axis=0) <= bound[:3]).all()
    assert (np.abs(second).max(axis=0) > bound[:3] / 100).all()
    # Signs of quaternions do not flip: half a turn per radian, 20 rad/s at most.
    assert np.abs(np.diff(orientation, axis=0)).max() < 20e-3 / 2


def test_poses_of_both_forms_agree():
    trajectory = random_trajectory("6dof", MINUTE, 2)
    X = np.random.default_rng(0).normal(size=(7, 3))
    for t in (MINUTE[0], 17.25 * SECOND, MINUTE[1]):
        R, T = trajectory.pose(t)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(R) == pytest.approx(1)
        position, orientation = trajectory.camera_pose(t)
        in_camera = Rotation.from_quat(orientation).inv().apply(X - position)
        np.testing.assert_allclose(X @ R.T + T, in_camera, atol=1e-13)
        assert (R @ [0, 1, 0])[2] > 0.7  # it looks ahead


def test_motion_starts_slow_gets_faster_and_is_as_its_name_says():
    t = np.arange(*MINUTE, SECOND // 100)
    measured = {}
    for motion in MOTIONS:
        speed = np.mean([speeds(random_trajectory(motion, MINUTE, seed), t) for seed in range(10)], axis=0)
        first, last = speed[:, :1000].mean(axis=1), speed[:, -1000:].mean(axis=1)
        assert (last > 2.5 * first).all()
        measured[motion] = speed.mean(axis=1)
    assert measured["rotation"][0] < 0.4 * measured["6dof"][0]
    assert measured["translation"][1] < 0.4 * measured["6dof"][1]


@pytest.mark.parametrize("scene", ["shapes", "poster", "boxes"])
def test_angular_speed_is_that_of_the_dataset(scene):
    folder = recording(f"event_camera_dataset/{scene}_rotation/motion.txt").parent
    real = np.linalg.norm(np.loadtxt(folder / "motion.txt"))
    begin, end = (np.loadtxt(folder / "events.txt")[[0, -1], 0] * SECOND).astype(int)
    t = MINUTE[0] + np.linspace(begin, end, 20).astype(int)
    simulated = [speeds(random_trajectory("rotation", MINUTE, seed), t)[1].mean() for seed in range(200)]
    assert np.quantile(simulated, 0.02) < real < np.quantile(simulated, 0.98)


def test_a_longer_span_begins_with_the_same_path():
    short, long = (random_trajectory("6dof", (0, s * SECOND), 9) for s in (1, 30))
    for a, b in zip(short.pose(0.7 * SECOND), long.pose(0.7 * SECOND), strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.allclose(random_trajectory("6dof", MINUTE, 8).pose(2e9)[0], long.pose(2e9)[0])
