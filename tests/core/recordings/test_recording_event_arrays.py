"""Arrays with one element per event, of ROS 1 and ROS 2 bags, against messages that the bag library builds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from recording_bags import CAMERA, everything, expect_error, info, packet, some_events, write_bag, write_sqlite
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from esfo_core.codecs import decoder
from esfo_core.errors import RecordingError
from esfo_core.events import make_events
from esfo_core.packets import EVENT_ARRAYS, OLD_EVENT_PACKET
from esfo_core.recordings.event_messages import reader_of
from esfo_core.recordings.messages import CAMERA_INFO

EVENT = "uint16 x\nuint16 y\nbuiltin_interfaces/Time ts\nbool polarity\n"
ARRAY = "std_msgs/Header header\nuint32 height\nuint32 width\n"


def store_of(kind, ros1, event=EVENT):
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    package = kind.split("/")[0]
    store.register(get_types_from_msg(event, f"{package}/msg/Event"))
    store.register(get_types_from_msg(f"{ARRAY}{package}/Event[] events\n", kind))
    return store


def serialised(store, kind, events, ros1, seq=0, frame_id="camera", size=(64, 48)):
    """One message, its events built one by one."""
    types = store.types
    event, time = types[kind.replace("EventArray", "Event")], types["builtin_interfaces/msg/Time"]
    stamp = time(sec=1_700_000_000, nanosec=5)
    header = types["std_msgs/msg/Header"](**{"seq": seq} if ros1 else {}, stamp=stamp, frame_id=frame_id)
    elements = [event(x, y, time(t // 10**9, t % 10**9), bool(p)) for x, y, p, t in events.tolist()]
    message = types[kind](header=header, width=size[0], height=size[1], events=elements)
    return bytes(store.serialize_ros1(message, kind) if ros1 else store.serialize_cdr(message, kind))


def event_array_bag(path, kind, messages, event=EVENT):
    ros1 = path.suffix == ".bag"
    store = store_of(kind, ros1, event)
    if ros1:
        with Rosbag1Writer(path) as writer:
            connection = writer.add_connection("/dvs/events", kind, typestore=store)
            for i, data in enumerate(messages):
                writer.write(connection, i, data)
        return path
    if path.suffix == ".db3":
        return write_sqlite(path, kind, messages)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros2")
        for topic, name, contents in (
            ("/dvs/events", kind, messages),
            ("/dvs/camera_info", CAMERA_INFO, [info(CAMERA)]),
        ):
            definition = store.generate_msgdef(name, ros_version=2)[0].encode()
            channel = writer.register_channel(topic, "cdr", writer.register_schema(name, "ros2msg", definition))
            for i, data in enumerate(contents):
                writer.add_message(channel, i, bytes(data), i)
        writer.finish()
    return path


@pytest.mark.parametrize("kind", EVENT_ARRAYS)
@pytest.mark.parametrize("suffix", ["bag", "mcap", "db3"])
def test_bags_of_event_arrays(tmp_path, kind, suffix):
    events = some_events(3000, start=1_699_999_999 * 10**9)
    ros1 = suffix == "bag"
    store = store_of(kind, ros1)
    parts = [some_events(0), *np.array_split(events, 6), events[-1:]]
    messages = [serialised(store, kind, part, ros1, seq) for seq, part in enumerate(parts)]
    recording, chunks = everything(event_array_bag(tmp_path / f"old.{suffix}", kind, messages))
    assert (np.concatenate(chunks) == np.concatenate(parts)).all()
    assert (recording.width, recording.height) == (64, 48)
    name = f"{kind.split('/')[0]}/EventArray"
    storage = {"bag": "ROS 1 bag", "mcap": "ROS 2 bag (MCAP)", "db3": "ROS 2 bag (SQLite)"}[suffix]
    assert recording.format == f"{storage}, {name}"
    assert recording.statistics.packets == len(parts)
    assert recording.statistics.decoder.trailing_bytes == 0
    assert recording.statistics.host_offset == 1_700_000_000 * 10**9 + 5 - events["t"][0]
    assert recording.progress() == 1.0
    assert (recording.camera is None) == (suffix != "mcap")


@settings(max_examples=100, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, 70), st.integers(0, 50), st.booleans(), st.integers(0, 2**31 * 10**9 - 1)), max_size=12
    ),
    st.text(max_size=6).filter(lambda text: "\0" not in text),
    st.booleans(),
)
def test_any_events_and_frame_names(rows, frame_id, ros1):
    rows.sort(key=lambda row: row[3])
    events = make_events(*(np.array(column) for column in zip(*rows, strict=True))) if rows else some_events(0)
    kind = EVENT_ARRAYS[0]
    message = reader_of(kind, ros1)(serialised(store_of(kind, ros1), kind, events, ros1, 7, frame_id))
    assert (message.frame_id, message.width, message.height) == (frame_id, 64, 48)
    assert message.seq == (7 if ros1 else None)
    d = decoder(message.encoding, 64, 48)
    inside = (events["x"] < 64) & (events["y"] < 48)
    assert (d.decode(message.data) == events[inside]).all()
    assert d.statistics.out_of_range == np.count_nonzero(~inside)


@pytest.mark.parametrize("suffix", ["bag", "mcap"])
def test_cut_messages_are_counted(tmp_path, suffix):
    ros1 = suffix == "bag"
    store = store_of(EVENT_ARRAYS[0], ros1)
    parts = np.array_split(some_events(500), 5)
    messages = [serialised(store, EVENT_ARRAYS[0], part, ros1, seq) for seq, part in enumerate(parts)]
    count = messages[1].index(np.array([48, 64, 100], "<u4").tobytes()) + 8
    messages[1] = messages[1][:-1]
    messages[2] = messages[2][:20]
    messages[3] = messages[3][:count] + b"\xff" * 4 + messages[3][count + 4 :]  # 4 billion events
    recording, chunks = everything(event_array_bag(tmp_path / f"old.{suffix}", EVENT_ARRAYS[0], messages))
    assert (recording.statistics.packets, recording.statistics.packets_damaged) == (2, 3)
    assert (np.concatenate(chunks) == np.concatenate([parts[0], parts[4]])).all()


def test_missing_messages_are_counted_where_they_have_numbers(tmp_path):
    store = store_of(EVENT_ARRAYS[0], True)
    parts = np.array_split(some_events(500), 5)
    messages = [serialised(store, EVENT_ARRAYS[0], part, True, seq) for seq, part in enumerate(parts)]
    recording, _ = everything(event_array_bag(tmp_path / "old.bag", EVENT_ARRAYS[0], [messages[i] for i in (0, 3, 4)]))
    assert recording.statistics.packets_lost == 2


@pytest.mark.parametrize("suffix", ["bag", "mcap"])
def test_other_fields_under_the_same_name_are_refused(tmp_path, suffix):
    kind, ros1 = EVENT_ARRAYS[0], suffix == "bag"
    other = EVENT.replace("uint16 y", "uint32 y")
    data = serialised(store_of(kind, ros1, other), kind, some_events(3), ros1)
    path = event_array_bag(tmp_path / f"old.{suffix}", kind, [data], other)
    expect_error(path, "dvs_msgs/msg/Event is defined with other fields in the bag: x, y, ts, polarity")


def test_negative_times_are_refused():
    with pytest.raises(RecordingError, match="times from -1000000000 to -1000000000 are out of the range"):
        decoder("cdr_event_array", 64, 48).decode(bytes(4) + b"\xff" * 4 + bytes(5))


def test_bytes_that_make_no_event_are_counted():
    for encoding, size, whole in (("cdr_event_array", 13, 1), ("cdr_event_array", 30, 2), ("ros1_event_array", 27, 2)):
        for extra in (0, 1):
            d = decoder(encoding, 64, 48)
            assert len(d.decode(bytes(size + extra))) == whole
            assert d.statistics.trailing_bytes == (size + extra) - {1: 13, 2: 29 if encoding[0] == "c" else 26}[whole]


def test_packets_under_their_old_name(tmp_path):
    data = packet(some_events())
    path = write_bag(tmp_path / "old.mcap", [("/events", OLD_EVENT_PACKET, data)])
    recording, chunks = everything(path)
    assert recording.format == "ROS 2 bag (MCAP), mono"
    assert (np.concatenate(chunks) == some_events()).all()


@pytest.mark.parametrize("kind", EVENT_ARRAYS)
def test_an_mcap_of_ros1_messages(tmp_path, kind):
    store, path, parts = store_of(kind, ros1=True), tmp_path / "a.mcap", np.array_split(some_events(300), 3)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros1")
        definition = store.generate_msgdef(kind, ros_version=1)[0].encode()
        schema = writer.register_schema(kind.replace("/msg/", "/"), "ros1msg", definition)
        channel = writer.register_channel("/dvs/events", "ros1", schema)
        for i, part in enumerate(parts):
            writer.add_message(channel, i, serialised(store, kind, part, True, i), i)
        writer.finish()
    recording, chunks = everything(path)
    assert (np.concatenate(chunks) == some_events(300)).all()
    assert recording.statistics.packets == 3
