"""Messages of events from a topic or a bag: `EventPacket`, and arrays with one element per event."""

from __future__ import annotations

from dataclasses import dataclass

from esfo_core.cdr import CdrReader
from esfo_core.codecs.base import Bytes
from esfo_core.codecs.event_array import cdr_size
from esfo_core.errors import RecordingError
from esfo_core.events import NS_PER_S

EVENT_PACKET = "event_camera_msgs/msg/EventPacket"
OLD_EVENT_PACKET = "event_array_msgs/msg/EventArray"
"""The former name of `EventPacket`, with the same fields."""

EVENT_ARRAYS = (
    "dvs_msgs/msg/EventArray",
    "prophesee_event_msgs/msg/EventArray",
    "dv_ros2_msgs/msg/EventArray",
    "dv_ros_msgs/msg/EventArray",
)
"""Types with the fields of `dvs_msgs/EventArray`, here under the names of ROS 2."""

SUPPORTED = (EVENT_PACKET, OLD_EVENT_PACKET, *EVENT_ARRAYS)
"""Names of the message types that hold events, the usual one first."""

_ENCODINGS = {"<": "cdr_event_array", ">": "cdr_event_array_be"}


@dataclass(frozen=True)
class Packet:
    """One message of events, not decoded yet.

    seq: its number, None where the message has none. width, height: of the sensor, px. data: the events in the
    `encoding` that `codecs.decoder` reads. big_endian: byte order of its words. time_base: as the encoding has it, ns.
    stamp: host time of the header, ns. host_times: the times of its events are host times already, not sensor times.
    """

    seq: int | None
    width: int
    height: int
    encoding: str
    big_endian: bool
    time_base: int
    data: Bytes
    stamp: int
    frame_id: str
    host_times: bool = False


def packet_from_cdr(type_name: str, data: bytes) -> Packet:
    """Return a serialised message without copying its events.

    type_name: one of `SUPPORTED`. data: the message with its encapsulation header, in either byte order.

    Raises RecordingError for another type and for a damaged message.
    """
    if type_name not in SUPPORTED:
        raise RecordingError(f"{type_name} is no type of events; known: {', '.join(SUPPORTED)}")
    read = _event_array if type_name in EVENT_ARRAYS else _event_packet
    return read(CdrReader(data))


def sequence_of(type_name: str, data: bytes) -> int | None:
    """Return the number of a serialised message, at the cost of reading a few fields.

    None where the type has no number, or where the message is so damaged that `packet_from_cdr` will refuse it.
    """
    if type_name not in (EVENT_PACKET, OLD_EVENT_PACKET):
        return None
    try:
        reader = CdrReader(data)
        _, _, length = reader.numbers("iII", 4)
        reader.bytes(length)
        reader.numbers("II", 4)
        return reader.numbers("Q", 8)[0]
    except RecordingError:
        return None


def _event_packet(reader: CdrReader) -> Packet:
    stamp, frame_id = _header(reader)
    height, width = reader.numbers("II", 4)
    seq, time_base = reader.numbers("QQ", 8)
    encoding = reader.text()
    (big_endian,) = reader.numbers("B", 1)
    (size,) = reader.numbers("I", 4)
    events = reader.bytes(size)
    reader.finish()
    return Packet(seq, width, height, encoding, bool(big_endian), time_base, events, stamp, frame_id)


def _event_array(reader: CdrReader) -> Packet:
    stamp, frame_id = _header(reader)
    height, width, count = reader.numbers("III", 4)
    events = reader.bytes(cdr_size(count))
    reader.finish()
    return Packet(None, width, height, _ENCODINGS[reader.byte_order], False, 0, events, stamp, frame_id, True)


def _header(reader: CdrReader) -> tuple[int, str]:
    seconds, nanoseconds = reader.numbers("iI", 4)
    return seconds * NS_PER_S + nanoseconds, reader.text()
