"""Serialised messages that hold events: `EventPacket`, and the arrays of one element per event that came before it."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import get_types_from_msg

from esfo_core.codecs.event_array import ROS1_EVENT, cdr_size
from esfo_core.errors import RecordingError
from esfo_core.recordings.messages import EVENT_PACKET, OLD_EVENT_PACKET, header, typestore

EVENT_ARRAYS = ("dvs_msgs/msg/EventArray", "prophesee_event_msgs/msg/EventArray", "dv_ros2_msgs/msg/EventArray")
"""Types with the fields of `dvs_msgs/EventArray`, here under the names of ROS 2."""

EVENT_KINDS = (EVENT_PACKET, OLD_EVENT_PACKET, *EVENT_ARRAYS)

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


@dataclass(frozen=True)
class EventArrayMessage:
    """An `EventArray` with the attributes of an `EventPacket`: its events as bytes for the decoder of `encoding`.

    seq: None in ROS 2, whose header has no number.
    """

    header: Any
    height: int
    width: int
    encoding: str
    is_bigendian: bool
    events: NDArray[np.uint8]
    seq: int | None = None
    time_base: int = 0


def reader_of(kind: str, ros1: bool = False) -> Callable[[bytes], Any]:
    """Return what reads a serialised message of the type `kind`; it may raise anything for damaged bytes."""
    if kind in EVENT_ARRAYS:
        return _read_ros1 if ros1 else _read_cdr
    store = typestore(ros1)
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


def _read_cdr(data: bytes) -> EventArrayMessage:
    order = "<" if data[1] & 1 else ">"
    seconds, nanoseconds, length = struct.unpack_from(f"{order}iII", data, 4)
    frame_id = bytes(data[16 : 16 + length]).rstrip(b"\0").decode()
    position = 16 + length + -length % 4
    height, width, count = struct.unpack_from(f"{order}III", data, position)
    events = np.frombuffer(data, np.uint8, cdr_size(count), position + 12)
    stamp = header(seconds * 1_000_000_000 + nanoseconds, frame_id)
    return EventArrayMessage(stamp, height, width, "cdr_event_array", order == ">", events)


def _read_ros1(data: bytes) -> EventArrayMessage:
    seq, seconds, nanoseconds, length = struct.unpack_from("<IIII", data)
    frame_id = bytes(data[16 : 16 + length]).decode()
    height, width, count = struct.unpack_from("<III", data, 16 + length)
    events = np.frombuffer(data, np.uint8, ROS1_EVENT.itemsize * count, 28 + length)
    stamp = header(seconds * 1_000_000_000 + nanoseconds, frame_id)
    return EventArrayMessage(stamp, height, width, "ros1_event_array", False, events, seq)
