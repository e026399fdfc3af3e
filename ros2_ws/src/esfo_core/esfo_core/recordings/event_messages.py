"""Messages of events in bags: readers by type, and a check of the definitions in a bag."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
from backports import zstd
from rosbags.typesys import get_types_from_msg

from esfo_core.codecs.event_array import ROS1_EVENT
from esfo_core.errors import RecordingError
from esfo_core.events import NS_PER_S
from esfo_core.packets import EVENT_ARRAYS, SUPPORTED, Packet, packet_from_cdr
from esfo_core.recordings.messages import stamp_of, typestore

_ZSTANDARD = b"\x28\xb5\x2f\xfd"  # no message begins so: CDR begins with zeros, ROS 1 with small numbers

_EVENT_ARRAY_DEFINITION = """\
std_msgs/Header header
uint32 height
uint32 width
{package}/Event[] events
================================================================================
MSG: {package}/Event
uint16 x
uint16 y
builtin_interfaces/Time ts
bool polarity
"""


def reader_of(kind: str, ros1: bool = False) -> Callable[[bytes], Any]:
    """Return a function that reads a serialised message of the type `kind`; those of `SUPPORTED` become a `Packet`.

    Bags of compression_mode MESSAGE have every message in Zstandard. It may raise anything for damaged bytes.
    """
    read = _plain_reader(kind, ros1)
    return lambda data: read(zstd.decompress(bytes(data)) if bytes(data[:4]) == _ZSTANDARD else data)


def _plain_reader(kind: str, ros1: bool) -> Callable[[bytes], Any]:
    if kind in SUPPORTED and not ros1:
        return partial(packet_from_cdr, kind)
    if kind in EVENT_ARRAYS:
        return _ros1_event_array
    store = typestore(ros1)
    if kind in SUPPORTED:
        return lambda data: _ros1_event_packet(store.deserialize_ros1(data, kind))
    deserialise = store.deserialize_ros1 if ros1 else store.deserialize_cdr
    return lambda data: deserialise(data, kind)


def check_definition(kind: str, definition: str) -> None:
    """Raise RecordingError unless an event array is defined as this reader has it; for other types do nothing.

    definition: the text that the bag has, empty where it has none.
    """
    if kind not in EVENT_ARRAYS or not definition:
        return
    try:
        found = get_types_from_msg(definition, kind)
    except Exception as error:
        raise RecordingError(f"the definition of {kind} in the bag cannot be read") from error
    for name, (_, fields) in _expected(kind).items():
        if name not in found or found[name][1] != fields:
            raise RecordingError(f"{name} is defined with other fields in the bag: {_names(found.get(name))}")


@cache
def _expected(kind: str) -> Any:
    return get_types_from_msg(_EVENT_ARRAY_DEFINITION.format(package=kind.partition("/")[0]), kind)


def _names(definition: Any) -> str:
    return "none" if definition is None else ", ".join(name for name, _ in definition[1])


def _ros1_event_packet(message: Any) -> Packet:
    return Packet(
        seq=int(message.seq),
        width=int(message.width),
        height=int(message.height),
        encoding=str(message.encoding),
        big_endian=bool(message.is_bigendian),
        time_base=int(message.time_base),
        data=message.events,
        stamp=stamp_of(message),
        frame_id=str(message.header.frame_id),
    )


def _ros1_event_array(data: bytes) -> Packet:
    seq, seconds, nanoseconds, length = struct.unpack_from("<IIII", data)
    frame_id = bytes(data[16 : 16 + length]).decode()
    height, width, count = struct.unpack_from("<III", data, 16 + length)
    events = np.frombuffer(data, np.uint8, ROS1_EVENT.itemsize * count, 28 + length)
    stamp = seconds * NS_PER_S + nanoseconds
    return Packet(seq, width, height, "ros1_event_array", False, 0, events, stamp, frame_id, True)
