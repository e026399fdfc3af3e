"""The text files of the Event Camera Dataset: written, read back, real and broken."""

from __future__ import annotations

import numpy as np
import pytest
from recording_truth import recording
from scipy.spatial.transform import Rotation

from esfo_core.camera import Camera
from esfo_core.errors import CameraError, RecordingError
from esfo_core.events import make_events
from esfo_core.recordings import open_recording
from esfo_core.recordings.event_camera_dataset import read_calib, read_groundtruth, write_event_camera_dataset
from esfo_simulation.handheld.scene import DAVIS240C
from esfo_simulation.handheld.trajectory import random_trajectory

SPAN = (1_000_000_000, 1_052_000_000)
POSE = "1.5 0.1 0.2 0.3 0 0 0 1\n"


@pytest.fixture
def written(tmp_path):
    rng = np.random.default_rng(2)
    t = np.sort(rng.integers(*SPAN, 5000))
    events = make_events(rng.integers(0, 240, 5000), rng.integers(0, 180, 5000), rng.integers(0, 2, 5000), t)
    trajectory = random_trajectory("6dof", SPAN, 3)
    folder = tmp_path / "made" / "shapes"
    assert write_event_camera_dataset(folder, np.array_split(events, [0, 1, 700]), trajectory, DAVIS240C) == 5000
    return folder, events, trajectory


def test_events_come_back(written):
    folder, events, _ = written
    np.testing.assert_array_equal(np.concatenate(list(open_recording(folder / "events.txt").chunks())), events)
    first = (folder / "events.txt").read_text().splitlines()[0].split()
    assert len(first) == 4
    assert len(first[0].partition(".")[2]) == 9


def test_poses_come_back_at_200_hz_and_at_the_end(written):
    folder, _, trajectory = written
    poses = read_groundtruth(folder / "groundtruth.txt")
    np.testing.assert_array_equal(poses.t, [*range(*SPAN, 5_000_000), SPAN[1]])
    position, orientation = trajectory.camera_poses(poses.t)
    np.testing.assert_array_equal(poses.position, position)
    np.testing.assert_allclose(poses.orientation, orientation, atol=1e-15)
    R, T = poses.world_to_camera(poses.t)
    for k, t in enumerate(poses.t):
        np.testing.assert_allclose(R[k], trajectory.pose(t)[0], atol=1e-12)
        np.testing.assert_allclose(T[k], trajectory.pose(t)[1], atol=1e-12)


def test_camera_comes_back(written):
    camera = read_calib(written[0] / "calib.txt")
    assert (camera.width, camera.height, camera.distortion_model) == (240, 180, "plumb_bob")
    np.testing.assert_array_equal(camera.K, DAVIS240C.K)
    np.testing.assert_array_equal(camera.D, DAVIS240C.D)


def test_between_two_poses_the_motion_is_even(tmp_path):
    half = Rotation.from_rotvec([0, 0, 1.0]).as_quat()
    lines = ["1700000000.000000001 0 0 0 0 0 0 1", f"1700000000.004000001 1 2 -4 {' '.join(map(str, -half))}"]
    (tmp_path / "groundtruth.txt").write_text("# comment\n\n" + "\n".join(lines))
    poses = read_groundtruth(tmp_path / "groundtruth.txt")
    begin = 1_700_000_000_000_000_001
    np.testing.assert_array_equal(poses.t, [begin, begin + 4_000_000])
    R, T = poses.world_to_camera(np.array([begin + 1_000_000]))
    np.testing.assert_allclose(R[0].T, Rotation.from_rotvec([0, 0, 0.25]).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(-R[0].T @ T[0], [0.25, 0.5, -1], atol=1e-12)
    with pytest.raises(RecordingError, match=str(begin - 1)):
        poses.world_to_camera(np.array([begin, begin - 1]))


def test_a_single_pose_is_that_of_its_time(tmp_path):
    (tmp_path / "groundtruth.txt").write_text(POSE)
    R, T = read_groundtruth(tmp_path / "groundtruth.txt").world_to_camera(np.array([1_500_000_000]))
    np.testing.assert_array_equal(R, [np.eye(3)])
    np.testing.assert_array_equal(T, [[-0.1, -0.2, -0.3]])


def test_real_poses_and_calibration():
    folder = recording("event_camera_dataset/shapes_rotation/groundtruth.txt").parent
    poses = read_groundtruth(folder / "groundtruth.txt")
    assert len(poses.t) == 300
    assert (poses.t[0], poses.t[-1]) == (1_501_918_432, 2_996_964_854)
    assert np.abs(np.diff(poses.t) - 5e6).max() < 1e4
    R, T = poses.world_to_camera(poses.t[:1])
    np.testing.assert_allclose(-R[0].T @ T[0], [4.46396824384, 1.5695947821, 1.42633661783], atol=1e-12)
    camera = read_calib(folder / "calib.txt")
    np.testing.assert_array_equal(
        camera.K, [[199.092366542, 0, 132.192071378], [0, 198.82882047, 110.712660011], [0, 0, 1]]
    )
    np.testing.assert_array_equal(
        camera.D, [-0.368436311798, 0.150947243557, -0.000296130534385, -0.000759431726241, 0]
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "no pose"),
        ("# t px py pz\n", "no pose"),
        (POSE + "1.6 0 0 0 0 0 1\n", "line 2 is not t px py"),
        (POSE + "1.6 0 0 0 0 0 0 1 7\n", "line 2 is not t px py"),
        (POSE + "1.6 0 0 here 0 0 0 1\n", "line 2 is no pose: .*here"),
        ("now 0 0 0 0 0 0 1\n", "line 1 is no pose: .*now"),
        ("inf 0 0 0 0 0 0 1\n", "line 1 is no pose: .*inf"),
        ("nan 0 0 0 0 0 0 1\n", "line 1 is no pose: .*nan"),
        ("1e30 0 0 0 0 0 0 1\n", "line 1 is no pose: .*1e30"),
        ("1.5 0 nan 0 0 0 0 1\n", "line 1 is not .*nan"),
        ("1.5 0 0 0 0 0 0 1.1\n", "line 1 .* length 1.1"),
        (POSE + POSE, "line 2 is at 1.5 s"),
        (b"\xff\xfe\x00", "not a text"),
    ],
)
def test_broken_poses_are_named(tmp_path, content, message):
    path = tmp_path / "groundtruth.txt"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(RecordingError, match=f"groundtruth.txt: .*{message}"):
        read_groundtruth(path)


def test_absent_files_are_named(tmp_path):
    with pytest.raises(RecordingError, match=r"groundtruth.txt: No such file"):
        read_groundtruth(tmp_path / "groundtruth.txt")
    with pytest.raises(CameraError, match=r"calib.txt: No such file"):
        read_calib(tmp_path / "calib.txt")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "0 numbers"),
        ("199 199 132 110", "4 numbers"),
        ("199 199 132 110 0 0 0 0 0 0", "10 numbers"),
        ("199 199 132 110 a b c d e", "'a'"),
        ("-199 199 132 110 0 0 0 0 0", "-199"),
        ("199 199 132 110 nan 0 0 0 0", "nan"),
    ],
)
def test_broken_calibrations_are_named(tmp_path, content, message):
    (tmp_path / "calib.txt").write_text(content)
    with pytest.raises(CameraError, match=f"calib.txt.*{message}"):
        read_calib(tmp_path / "calib.txt")


def test_a_lens_that_the_file_cannot_hold_is_refused_before_anything_is_written(tmp_path):
    fisheye = Camera(240, 180, DAVIS240C.K, "equidistant", np.zeros(4))
    with pytest.raises(CameraError, match="equidistant"):
        write_event_camera_dataset(tmp_path / "new", [], random_trajectory("6dof", SPAN, 1), fisheye)
    assert not (tmp_path / "new").exists()
