"""Bags in several files, write-ahead logs, missing sizes, and which of several calibrations is taken."""

from __future__ import annotations

import shutil
import sqlite3

import numpy as np
import pytest
from recording_bags import (
    CAMERA,
    CAMERA_INFO,
    EVENT_PACKET,
    event_bag,
    everything,
    expect_error,
    info,
    packet,
    some_events,
    sqlite_bag,
    write_bag,
)

from esfo_core.camera import Camera
from esfo_core.errors import CameraError
from esfo_core.recordings import ReadingOptions, open_recording

EVENTS = some_events(2600)
OTHER = Camera.pinhole(640, 480, 500.0)
TOLD = ReadingOptions(width=64, height=48)


@pytest.mark.parametrize("name", ["rec_{}.mcap", "{}_rec_2026_11_27-10_00_00.mcap", "{}.mcap", "a1_{}_b2.mcap"])
@pytest.mark.parametrize("count", [9, 13, 130])
def test_parts_of_a_bag_are_in_the_order_of_their_numbers(tmp_path, name, count):
    for k, part in enumerate(np.array_split(EVENTS, count)):
        event_bag(tmp_path / name.format(k), packet(part, k))
    recording, chunks = everything(tmp_path)
    assert (np.concatenate(chunks) == EVENTS).all()
    assert (recording.statistics.packets_lost, recording.statistics.segments) == (0, 1)


@pytest.mark.parametrize("in_the_log", [5, 20])
def test_messages_in_a_write_ahead_log_are_read(tmp_path, in_the_log):
    parts = np.array_split(EVENTS, 20)
    path = sqlite_bag(tmp_path / "rec_0.db3", parts[: 20 - in_the_log])
    folder = tmp_path / "copy"
    folder.mkdir()
    with sqlite3.connect(path) as db:
        db.execute("PRAGMA journal_mode=WAL")
        db.execute("PRAGMA wal_autocheckpoint=0")
        for seq, part in enumerate(parts[20 - in_the_log :], 20 - in_the_log):
            db.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", (seq, packet(part, seq)))
        db.commit()
        for file in tmp_path.glob("rec_0.db3*"):
            shutil.copy(file, folder)  # as it lies there while the recorder lives
    db.close()
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    recording, chunks = everything(folder / "rec_0.db3")
    assert (np.concatenate(chunks) == EVENTS).all()
    assert recording.statistics.packets == 20
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before
    (folder / "rec_0.db3-wal").write_bytes(b"junk" * 100)
    if in_the_log == 5:
        assert len(np.concatenate(everything(folder)[1])) < len(EVENTS)


@pytest.mark.parametrize(
    "messages",
    [
        [("/e", 0, 0), ("/e", 0, 0)],
        [("/e", 0, 48)],
    ],
)
def test_packets_without_a_size(tmp_path, messages):
    sizes = [(width, height) for _, width, height in messages]
    parts = np.array_split(EVENTS, len(sizes))
    data = [packet(part, k, width=w, height=h) for k, (part, (w, h)) in enumerate(zip(parts, sizes, strict=True))]
    path = write_bag(tmp_path / "bag.mcap", [("/events", EVENT_PACKET, d) for d in data])
    for options, inferred in ((TOLD, False), (ReadingOptions(), True)):
        recording, chunks = everything(path, options=options)
        assert (recording.width, recording.height, recording.size_inferred) == (64, 48, inferred)
        assert (np.concatenate(chunks) == EVENTS).all()


@pytest.mark.parametrize("header", [b"% Version 2\n% end\n\x0c\x08", b"% evt 2.0\n% system_ID 49\n% end\n"])
def test_prophesee_files_without_a_size(tmp_path, header):
    t, x, y, p = ((EVENTS[name] // (1000 if name == "t" else 1)).astype("<u4") for name in "txyp")
    words = np.stack([t, x | y << 14 | p << 28], axis=1)
    if b"evt" in header:
        words = np.stack([0x8 << 28 | t >> 6, p << 28 | (t & 63) << 22 | x << 11 | y], axis=1)
    path = tmp_path / "file.raw"
    path.write_bytes(header + words.astype("<u4").tobytes())
    for options, inferred in ((TOLD, False), (ReadingOptions(), True)):
        recording, chunks = everything(path, options=options)
        assert (recording.width, recording.height, recording.size_inferred) == (64, 48, inferred)
        assert len(np.concatenate(chunks)) == len(EVENTS)
    words[[3, 900], -1] |= 0x3FFF if b"evt" not in header else 0x7FF << 11  # stray pixels
    path.write_bytes(header + words.astype("<u4").tobytes())
    recording, chunks = everything(path)
    assert (recording.width, recording.height, len(np.concatenate(chunks))) == (64, 48, len(EVENTS) - 2)


def camera_of(path, *infos):
    messages = [(topic, CAMERA_INFO, info(camera, **changes)) for topic, camera, changes in infos]
    return open_recording(write_bag(path, [*messages, ("/cam/events", EVENT_PACKET, packet(EVENTS))])).camera


def test_the_calibration_that_fits_is_taken(tmp_path):
    path = tmp_path / "bag.mcap"
    blank = {"k": np.zeros(9), "width": 0, "height": 0}
    same, longer = ("/camera_info", CAMERA, {}), Camera.pinhole(64, 48, 70.0)
    assert camera_of(path, ("/rgb/camera_info", OTHER, {}), same).focal_px == 60
    assert camera_of(path, ("/cam/camera_info", CAMERA, blank), ("/cam/camera_info", CAMERA, {})).focal_px == 60
    assert camera_of(path, ("/cam/camera_info", CAMERA, blank)) is None
    assert camera_of(path, ("/cam/camera_info", CAMERA, blank), same).focal_px == 60
    assert camera_of(path, ("/cam/camera_info", CAMERA, {"width": 0, "height": 0})).focal_px == 60
    assert camera_of(path, ("/cam/camera_info", longer, {}), same).focal_px == 70
    assert camera_of(path, ("/rgb/camera_info", OTHER, {}), ("/ir/camera_info", OTHER, {})) is None
    assert camera_of(path, same, ("/b/camera_info", CAMERA, {})).focal_px == 60
    with pytest.raises(CameraError, match=r"several camera_info topics fit .*: /a/info, /camera_info"):
        camera_of(path, ("/a/info", longer, {}), same)


def test_an_empty_folder_of_a_bag_says_so(tmp_path):
    expect_error(tmp_path, "no ROS 2 bag of .mcap or .db3 files")
