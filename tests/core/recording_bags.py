"""Small bags with whatever content a test asks for."""

from __future__ import annotations

import random
import sqlite3

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as Rosbag1Writer

from esfo_core.camera import Camera
from esfo_core.codecs import encode_mono
from esfo_core.errors import RecordingError
from esfo_core.events import make_events
from esfo_core.packets import EVENT_PACKET
from esfo_core.recordings import open_recording
from esfo_core.recordings.messages import CAMERA_INFO, header, info_from_camera, typestore

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


def sqlite_bag(path, parts):
    return write_sqlite(path, EVENT_PACKET, [packet(part, seq) for seq, part in enumerate(parts)])


def write_sqlite(path, kind, messages):
    """Write serialised messages of one topic, without a definition, as early ROS 2 did."""
    with sqlite3.connect(path) as db:
        db.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
        db.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
        db.execute("INSERT INTO topics VALUES (1, '/events', ?, 'cdr')", (kind,))
        rows = [(1, seq, bytes(message)) for seq, message in enumerate(messages)]
        db.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
    db.close()
    return path


def ros1_bag(path, parts):
    store = typestore(ros1=True)
    with Rosbag1Writer(path) as writer:
        connection = writer.add_connection("/events", EVENT_PACKET, typestore=store)
        for seq, part in enumerate(parts):
            message = STORE.deserialize_cdr(packet(part, seq), EVENT_PACKET)
            stamp = store.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
            message.header = store.types["std_msgs/msg/Header"](seq=seq, stamp=stamp, frame_id="camera")
            writer.write(connection, seq, store.serialize_ros1(message, EVENT_PACKET))
    return path


def everything(path, **options):
    recording = open_recording(path, **options)
    return recording, list(recording.chunks())


def expect_error(path, message, **options):
    with pytest.raises(RecordingError, match=message) as caught:
        everything(path, **options)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def damaged_copies(content, number, seed, first, reaches=()):
    """Yield copies of a file with 1, 5 or 50 bytes changed between byte `first` and the end, or one of `reaches`."""
    rng = random.Random(seed)
    for _ in range(number):
        damaged = bytearray(content)
        for _ in range(rng.choice((1, 5, 50))):
            damaged[rng.randrange(first, rng.choice((*reaches, len(damaged))))] = rng.randrange(256)
        yield bytes(damaged)
