"""Serialised messages of events: what the bag library writes comes out, and damage is named, never another error."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_bags import STORE, some_events
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from esfo_core.codecs import decoder
from esfo_core.errors import RecordingError
from esfo_core.events import make_events
from esfo_core.packets import EVENT_ARRAYS, EVENT_PACKET, OLD_EVENT_PACKET, SUPPORTED, packet_from_cdr, sequence_of
from esfo_core.recordings.messages import header

STAMP = 1_700_000_000_000_000_005
ARRAY = "std_msgs/Header header\nuint32 height\nuint32 width\n"
EVENT = "uint16 x\nuint16 y\nbuiltin_interfaces/Time ts\nbool polarity\n"


def event_packet(events=b"", seq=7, frame_id="camera", encoding="mono", time_base=0, kind=EVENT_PACKET, little=True):
    message = STORE.types[kind](
        header=header(STAMP, frame_id),
        height=48,
        width=64,
        seq=seq,
        time_base=time_base,
        encoding=encoding,
        is_bigendian=False,
        events=np.frombuffer(events, np.uint8),
    )
    return bytes(STORE.serialize_cdr(message, kind, little_endian=little))


def event_array(events, kind=EVENT_ARRAYS[0], frame_id="camera", little=True):
    """One message, its events built one by one."""
    store = get_typestore(Stores.ROS2_JAZZY)
    package = kind.split("/")[0]
    store.register(get_types_from_msg(EVENT, f"{package}/msg/Event"))
    store.register(get_types_from_msg(f"{ARRAY}{package}/Event[] events\n", kind))
    types = store.types
    event, time = types[kind.replace("EventArray", "Event")], types["builtin_interfaces/msg/Time"]
    elements = [event(x, y, time(t // 10**9, t % 10**9), bool(p)) for x, y, p, t in events.tolist()]
    message = types[kind](header=header(STAMP, frame_id), width=64, height=48, events=elements)
    return bytes(store.serialize_cdr(message, kind, little_endian=little))


names = st.text(max_size=9).filter(lambda text: "\0" not in text)
uint64 = st.integers(0, 2**64 - 1)


@settings(max_examples=150, deadline=None)
@given(
    st.binary(max_size=40),
    uint64,
    uint64,
    names,
    names,
    st.sampled_from([EVENT_PACKET, OLD_EVENT_PACKET]),
    st.booleans(),
)
def test_any_packet_comes_out_as_the_bag_library_wrote_it(data, seq, time_base, frame_id, encoding, kind, little):
    message = event_packet(data, seq, frame_id, encoding, time_base, kind, little)
    packet = packet_from_cdr(kind, message)
    assert (packet.seq, packet.time_base, packet.frame_id, packet.encoding) == (seq, time_base, frame_id, encoding)
    assert (packet.width, packet.height, packet.stamp, packet.big_endian) == (64, 48, STAMP, False)
    assert bytes(packet.data) == data
    assert not packet.host_times
    assert sequence_of(kind, message) == seq


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.tuples(*[st.integers(0, n) for n in (63, 47, 1, 2**31 * 10**9 - 1)]), max_size=9),
    names,
    st.sampled_from(EVENT_ARRAYS),
    st.booleans(),
)
def test_any_array_of_events_in_either_byte_order(rows, frame_id, kind, little):
    rows.sort(key=lambda row: row[3])
    events = make_events(*(np.array(c) for c in zip(*rows, strict=True))) if rows else some_events(0)
    message = event_array(events, kind, frame_id, little)
    packet = packet_from_cdr(kind, message)
    assert (packet.width, packet.height, packet.stamp, packet.frame_id) == (64, 48, STAMP, frame_id)
    assert (packet.seq, packet.time_base, packet.host_times) == (None, 0, True)
    parts = decoder(packet.encoding, 64, 48).decode_parts(packet.data)
    assert (np.concatenate(parts) == events).all()
    assert sequence_of(kind, message) is None


def test_events_are_not_copied():
    message = event_packet(bytes(range(100)))
    data = np.frombuffer(packet_from_cdr(EVENT_PACKET, message).data, np.uint8)
    assert np.shares_memory(data, np.frombuffer(message, np.uint8))


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda m: b"", "begins with 0x is no plain CDR"),
        (lambda m: m[:3], "no plain CDR"),
        (lambda m: b"\0\7" + m[2:], "0x00070000 is no plain CDR"),
        (lambda m: m[:30], "has 30 bytes, but its fields need"),
        (lambda m: m[:-1], "need"),
        (lambda m: m + bytes(4), "4 bytes follow the last field"),
        (lambda m: m[:12] + b"\xff\xff\xff\x7f" + m[16:], "need 2147483663 or more"),
        (lambda m: m.replace(b"camera", b"cam\xffra"), "no text: b'cam"),
    ],
)
@pytest.mark.parametrize("kind", [EVENT_PACKET, EVENT_ARRAYS[1]])
def test_damage_is_named(kind, damage, says):
    message = event_packet(bytes(21)) if kind == EVENT_PACKET else event_array(some_events(5), kind)
    packet_from_cdr(kind, message)
    with pytest.raises(RecordingError, match=says):
        packet_from_cdr(kind, damage(message))


def test_padding_to_a_multiple_of_four_is_no_damage():
    message = event_packet(bytes(21))
    assert len(packet_from_cdr(EVENT_PACKET, message + bytes(3)).data) == 21


def test_a_type_that_holds_no_events_is_refused():
    with pytest.raises(RecordingError, match="sensor_msgs/msg/Image is no type of events"):
        packet_from_cdr("sensor_msgs/msg/Image", event_packet())
    assert sequence_of("sensor_msgs/msg/Image", event_packet()) is None


def test_random_damage_gives_a_packet_or_one_error():
    rng = random.Random(1)
    for kind in SUPPORTED:
        whole = event_array(some_events(20), kind) if kind in EVENT_ARRAYS else event_packet(bytes(90), kind=kind)
        for _ in range(2000):
            damaged = bytearray(whole[: rng.randrange(len(whole) + 1)] if rng.random() < 0.3 else whole)
            for _ in range(rng.choice((1, 3, 10)) if damaged else 0):
                damaged[rng.randrange(min(len(damaged), 60))] = rng.randrange(256)
            seq = sequence_of(kind, bytes(damaged))
            try:
                packet = packet_from_cdr(kind, bytes(damaged))
            except RecordingError:
                continue
            assert packet.seq == seq
            assert len(packet.data) <= len(whole)


def test_a_negative_time_is_that_of_one_event():
    slots = np.zeros((3, 16), np.uint8)
    slots[:, 4:12] = np.array([[5, 0], [2**31 + 5, 1], [5, 2]], "<u4").view(np.uint8)
    data = slots.ravel()
    for k, place in enumerate((0, 14, 30)):  # x and y of all but the first lie two bytes before their slots
        data[place : place + 4] = np.array([k + 1, 2], "<u2").view(np.uint8)
    d = decoder("cdr_event_array", 64, 48)
    assert d.decode(data[:45].tobytes())["x"].tolist() == [1, 3]
    assert d.statistics.impossible_times == 1
