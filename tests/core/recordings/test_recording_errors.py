"""Input that is no recording, or an impossible one: one clear error that names the path."""

from __future__ import annotations

import random

import numpy as np
import pytest
from recording_bags import CAMERA, event_bag, everything, expect_error, info, packet, some_events, write_bag

from esfo_core.camera import Camera
from esfo_core.errors import CameraError, EsfoError
from esfo_core.packets import EVENT_PACKET
from esfo_core.recordings import write_mcap
from esfo_core.recordings.messages import CAMERA_INFO


def test_paths_without_a_recording(tmp_path):
    expect_error(tmp_path / "none.mcap", "No such file")
    expect_error(tmp_path, "no ROS 2 bag")
    for name in ("empty.mcap", "empty.bag", "empty.raw"):
        (tmp_path / name).write_bytes(b"")
        expect_error(tmp_path / name, "is empty")
    (tmp_path / "noise.mcap").write_bytes(random.Random(1).randbytes(5000))
    expect_error(tmp_path / "noise.mcap", "not a recording of a known format")


def test_folders_that_are_no_bag(tmp_path):
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {relative_file_paths: [gone.mcap]}")
    expect_error(tmp_path, r"gone\.mcap: No such file")
    for text in ("[1, 2", "just text", "{}", "rosbag2_bagfile_information: {relative_file_paths: 3}"):
        (tmp_path / "metadata.yaml").write_text(text)
        expect_error(tmp_path, "metadata.yaml does not describe a bag")
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {relative_file_paths: [a.db3.zstd]}")
    expect_error(tmp_path, r"a\.db3\.zstd")


def test_several_files_of_one_bag_are_read_in_the_order_of_the_metadata(tmp_path):
    events = some_events()
    for name, part in zip(("z.mcap", "a.mcap"), np.array_split(events, 2), strict=True):
        write_mcap(tmp_path / name, [part], CAMERA)
    names = "rosbag2_bagfile_information: {storage_identifier: '', relative_file_paths: [z.mcap, a.mcap]}"
    (tmp_path / "metadata.yaml").write_text(names)
    _, chunks = everything(tmp_path)
    assert (np.concatenate(chunks) == events).all()


def test_bags_without_events(tmp_path):
    path = tmp_path / "bag.mcap"
    expect_error(write_bag(path, []), "no topic of type event_camera_msgs/msg/EventPacket")
    expect_error(write_bag(path, [("/camera_info", CAMERA_INFO, info(CAMERA))]), "no topic of type")
    expect_error(event_bag(path, None), "no messages on the event topic /events")
    expect_error(event_bag(path, packet(some_events(0))), "no events in 1 packets")
    expect_error(event_bag(path, b"\0\1\0\0junk"), "no readable message on the event topic '/events'")


def test_a_bag_with_several_event_topics_needs_a_choice(tmp_path):
    events = some_events(100)
    kinds = [("/left/events", EVENT_PACKET, packet(events)), ("/right/events", EVENT_PACKET, packet(events[:9]))]
    path = write_bag(tmp_path / "two.mcap", kinds)
    expect_error(path, "choose one of /left/events, /right/events")
    expect_error(path, "no event topic '/up'", topic="/up")
    assert everything(path, topic="/right/events")[0].statistics.events == 9


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"encoding": "evt9"}, "unknown event encoding 'evt9'"),
        ({"is_bigendian": True}, "big-endian"),
        ({"time_base": 2**63}, "packet 0: time base 9223372036854775808 ns"),
    ],
)
def test_impossible_packets(tmp_path, changes, message):
    expect_error(event_bag(tmp_path / "bag.mcap", packet(some_events(10), **changes)), message)


def test_a_stream_that_changes_its_size(tmp_path):
    path, events = tmp_path / "bag.mcap", some_events(10)
    expect_error(event_bag(path, packet(events), packet(events, 1, width=65)), "65x48 'mono' after 64x48 'mono'")


def test_cameras_in_bags(tmp_path):
    path, events = tmp_path / "bag.mcap", ("/cam/events", EVENT_PACKET, packet(some_events(10)))
    other = Camera.pinhole(640, 480, 500.0)

    def camera_of(*messages):
        return everything(write_bag(path, [*messages, events]))[0].camera

    assert camera_of() is None
    assert camera_of(("/cam/camera_info", CAMERA_INFO, info(CAMERA))).focal_px == 60
    assert camera_of(("/rgb/info", CAMERA_INFO, info(CAMERA))).focal_px == 60
    assert camera_of(("/rgb/camera_info", CAMERA_INFO, info(other))) is None
    two = [("/rgb/camera_info", CAMERA_INFO, info(other)), ("/cam/camera_info", CAMERA_INFO, info(CAMERA))]
    assert camera_of(*two).focal_px == 60
    assert camera_of(("/cam/camera_info", CAMERA_INFO, info(CAMERA, k=np.zeros(9)))) is None  # uncalibrated
    for model in ("none", ""):
        pinhole = camera_of(("/cam/camera_info", CAMERA_INFO, info(CAMERA, distortion_model=model, d=np.zeros(5))))
        assert (pinhole.focal_px, len(pinhole.D)) == (60, 0)
    with pytest.raises(CameraError, match="unknown distortion model 'none'"):
        camera_of(("/cam/camera_info", CAMERA_INFO, info(CAMERA, distortion_model="none", d=np.ones(5))))
    with pytest.raises(CameraError, match="640x480 pixels, the events of 64x48"):
        camera_of(("/cam/camera_info", CAMERA_INFO, info(other)))
    with pytest.raises(CameraError, match=r"bag\.mcap: '/cam/camera_info': camera matrix"):
        camera_of(("/cam/camera_info", CAMERA_INFO, info(CAMERA, k=np.full(9, np.nan))))


@pytest.mark.parametrize("camera", [info(CAMERA, k=np.full(9, np.nan)), info(Camera.pinhole(640, 480, 500.0))])
def test_events_beside_an_impossible_camera_can_be_read(tmp_path, camera):
    messages = [("/cam/camera_info", CAMERA_INFO, camera), ("/cam/events", EVENT_PACKET, packet(some_events(10)))]
    recording, chunks = everything(write_bag(tmp_path / "bag.mcap", messages))
    assert (np.concatenate(chunks) == some_events(10)).all()
    with pytest.raises(EsfoError, match=r"bag\.mcap: '/cam/camera_info'"):
        _ = recording.camera
