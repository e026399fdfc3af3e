"""Bad input: one clear RecordingError, or the good part with the loss counted; never another exception."""

from __future__ import annotations

import contextlib
import random
import shutil
import sqlite3

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from esfo_core.camera import Camera
from esfo_core.codecs import encode_mono
from esfo_core.errors import CameraError, EsfoError, RecordingError
from esfo_core.events import make_events
from esfo_core.recordings import open_recording, write_mcap
from esfo_core.recordings.messages import CAMERA_INFO, EVENT_PACKET, header, info_from_camera, typestore

CAMERA = Camera.pinhole(64, 48, 60.0)
STORE = typestore()


def some_events(n=20_000, start=0, seconds=0.4):
    rng = np.random.default_rng(3)
    t = start + np.sort(rng.integers(0, int(seconds * 1e9), n))
    return make_events(rng.integers(0, 64, n), rng.integers(0, 48, n), rng.integers(0, 2, n), t)


def packet(encoded, seq=0, **changes):
    fields = {
        "header": header(0, "camera"),
        "height": 48,
        "width": 64,
        "seq": seq,
        "time_base": int(encoded["t"][0]) if len(encoded) else 0,
        "encoding": "mono",
        "is_bigendian": False,
    }
    fields["events"] = np.frombuffer(encode_mono(encoded, fields["time_base"]), np.uint8)
    return STORE.serialize_cdr(STORE.types[EVENT_PACKET](**fields | changes), EVENT_PACKET)


def info(camera, **changes):
    message = info_from_camera(camera, 0, "camera")
    for name, value in changes.items():
        setattr(message, name, value)
    return STORE.serialize_cdr(message, CAMERA_INFO)


def write_bag(path, messages, chunk_size=1 << 16):
    """Write (topic, type, data) messages; None as data only registers the topic."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk_size, compression=CompressionType.NONE)
        writer.start(profile="ros2")
        channels = {}
        for i, (topic, kind, data) in enumerate(messages):
            if topic not in channels:
                schema = writer.register_schema(kind, "ros2msg", STORE.generate_msgdef(kind, ros_version=2)[0].encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            if data is not None:
                writer.add_message(channels[topic], i, bytes(data), i)
        writer.finish()
    return path


def event_bag(path, *packets, **options):
    return write_bag(path, [("/events", EVENT_PACKET, data) for data in packets], **options)


def everything(path, **options):
    recording = open_recording(path, **options)
    return recording, list(recording.chunks())


def expect_error(path, message, **options):
    with pytest.raises(RecordingError, match=message) as caught:
        everything(path, **options)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


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
        ({"width": 0}, "0x48"),
        ({"is_bigendian": True}, "big-endian"),
        ({"time_base": 2**63}, "packet 0: time base 9223372036854775808 ns"),
    ],
)
def test_impossible_packets(tmp_path, changes, message):
    expect_error(event_bag(tmp_path / "bag.mcap", packet(some_events(10), **changes)), message)


def test_a_stream_that_changes_its_size_or_steps_back(tmp_path):
    path, events = tmp_path / "bag.mcap", some_events(10)
    expect_error(event_bag(path, packet(events), packet(events, 1, width=65)), "65x48 'mono' after 64x48 'mono'")
    late = some_events(10, start=10**9)
    expect_error(event_bag(path, packet(late), packet(events, 1)), r"time steps back by 1\.\d+ s")


def test_damaged_and_missing_packets_are_counted(tmp_path):
    parts = np.array_split(some_events(), 8)
    packets = [packet(part, seq) for seq, part in enumerate(parts)]
    packets[3] = packets[3][:40]
    del packets[5:7]
    recording, chunks = everything(event_bag(tmp_path / "bag.mcap", *packets))
    s = recording.statistics
    assert (s.packets, s.packets_damaged, s.packets_lost) == (5, 1, 2)
    assert (np.concatenate(chunks) == np.concatenate([parts[i] for i in (0, 1, 2, 4, 7)])).all()


@pytest.mark.parametrize("broken", [True, False])
def test_a_loss_makes_a_stateful_decoder_wait(tmp_path, broken):
    words = [[0x0003, 0x8001, 0x6001, 0x2005], [0x0004], [0x2006, 0x8001, 0x6002, 0x2007, 0x0008, 0x2009]]
    none = some_events(0)
    packets = [packet(none, i, encoding="evt3", events=np.array(w, "<u2").view("u1")) for i, w in enumerate(words)]
    packets[1:2] = [packets[1][:30]] if broken else []
    recording, chunks = everything(event_bag(tmp_path / "bag.mcap", *packets))
    assert np.concatenate(chunks)[["x", "y"]].tolist() == [(5, 3), (9, 8)]
    assert recording.statistics.decoder.unsynchronised == 2


def test_a_cut_off_mcap_gives_its_whole_part(tmp_path):
    events = some_events()
    parts = np.array_split(events, 100)
    path = event_bag(tmp_path / "bag.mcap", *(packet(part, seq) for seq, part in enumerate(parts)), chunk_size=1 << 13)
    content = path.read_bytes()
    for size in (40, 200, len(content) // 3, len(content) // 2, len(content) - 9, len(content) - 1):
        path.write_bytes(content[:size])
        if size <= 200:
            expect_error(path, "no topic of type")
            continue
        recording, chunks = everything(path)
        got = np.concatenate(chunks)
        assert (got == events[: len(got)]).all()
        lost = recording.statistics.bytes_lost
        assert 0 < lost <= (1 << 14) + len(content) // 10  # an unfinished chunk, or the index at the end
        assert 0.9 * (size - lost) < 8 * len(got) < size


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
    with pytest.raises(RecordingError, match="640x480 pixels, the events of 64x48"):
        camera_of(("/cam/camera_info", CAMERA_INFO, info(other)))
    with pytest.raises(CameraError, match=r"bag\.mcap: '/cam/camera_info': camera matrix"):
        camera_of(("/cam/camera_info", CAMERA_INFO, info(CAMERA, k=np.full(9, np.nan))))


@pytest.fixture(params=["mcap", "db3", "bag"])
def bag(request, tmp_path):
    """A small bag of each storage."""
    path = tmp_path / f"bag.{request.param}"
    parts = np.array_split(some_events(2000), 20)
    if request.param == "mcap":
        return event_bag(path, *(packet(part, seq) for seq, part in enumerate(parts)))
    if request.param == "db3":
        return sqlite_bag(path, parts)
    return ros1_bag(path, parts)


def sqlite_bag(path, parts):
    with sqlite3.connect(path) as db:
        db.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
        db.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
        db.execute("INSERT INTO topics VALUES (1, '/events', ?, 'cdr')", (EVENT_PACKET,))
        rows = [(1, seq, bytes(packet(part, seq))) for seq, part in enumerate(parts)]
        db.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
    db.close()
    return path


def ros1_bag(path, parts):
    from rosbags.rosbag1 import Writer as Rosbag1Writer

    store = typestore(ros1=True)
    with Rosbag1Writer(path) as writer:
        connection = writer.add_connection("/events", EVENT_PACKET, typestore=store)
        for seq, part in enumerate(parts):
            message = STORE.deserialize_cdr(packet(part, seq), EVENT_PACKET)
            stamp = store.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
            message.header = store.types["std_msgs/msg/Header"](seq=seq, stamp=stamp, frame_id="camera")
            writer.write(connection, seq, store.serialize_ros1(message, EVENT_PACKET))
    return path


def test_every_storage_reads_the_same(bag):
    recording, chunks = everything(bag)
    assert (np.concatenate(chunks) == some_events(2000)).all()
    assert recording.statistics.packets == 20


def test_a_wrong_extension_is_named(bag):
    wrong = bag.with_suffix(".raw")
    shutil.copy(bag, wrong)
    expect_error(wrong, f"needs the extension {bag.suffix}")


def test_no_damage_raises_anything_else(bag):
    content = bag.read_bytes()
    rng = random.Random(5)
    for _ in range(60):
        damaged = bytearray(content)
        if rng.random() < 0.3:
            del damaged[rng.randrange(20, len(damaged)) :]
        for _ in range(rng.choice((0, 1, 5, 50))):
            damaged[rng.randrange(16, len(damaged))] = rng.randrange(256)
        bag.write_bytes(damaged)
        with contextlib.suppress(EsfoError):
            everything(bag)


EVT3_HEADER = b"% evt 3.0\n% format EVT3;height=48;width=64\n% end\n"
EVT3_EVENT = np.array([0x8001, 0x6001, 0x0003, 0x2805], "<u2").tobytes()


@pytest.mark.parametrize(
    ("header_lines", "size"),
    [
        (EVT3_HEADER, (64, 48)),
        (b"% evt 3.0\n% geometry 320x240\n", (320, 240)),
        (b"% Date now\n% evt 3.0\n% plugin_name hal_plugin_imx636_evk4\n", (1280, 720)),
        (b"% format EVT3\n% Width 304\n% Height 240\n", (304, 240)),
    ],
)
def test_raw_headers(tmp_path, header_lines, size):
    path = tmp_path / "scene.raw"
    path.write_bytes(header_lines + EVT3_EVENT)
    recording, chunks = everything(path)
    assert (recording.width, recording.height) == size
    assert [tuple(int(v) for v in row) for row in chunks[0]] == [(5, 3, 1, 4_097_000)]
    path.write_bytes(header_lines + EVT3_EVENT + b"\0")
    assert everything(path)[0].statistics.decoder.trailing_bytes == 1


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (EVT3_HEADER, "no events in 0 packets"),
        (EVT3_HEADER + EVT3_EVENT[:6], "no events in 1 packets"),
        (b"% evt 3.0\n", "no sensor size"),
        (b"% evt 3.0\n% geometry big\n", "'big' x ''"),
        (b"% evt 3.0\n% geometry 0x480\n", "0x480"),
        (b"% evt 2.1\n% geometry 640x480\n", "unknown event encoding 'evt2.1'"),
        (b"% Date today\n", "names no event format .it has date"),
        (b"% evt 3.0", "no end"),
        (b"% Version 2\n% Width 64\n% Height 48\n", "ends after its header"),
        (b"% Version 2\n% Width 64\n% Height 48\n\x0e\x08" + bytes(8), "type 0x0e"),
    ],
)
def test_bad_raw_and_dat_files(tmp_path, content, message):
    path = tmp_path / "scene.raw"
    path.write_bytes(content)
    expect_error(path, message)
