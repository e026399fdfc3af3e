"""Writing a ROS 2 bag: one self-contained MCAP file with events and camera."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from esfo_core.camera import Camera
from esfo_core.codecs import encoder
from esfo_core.errors import RecordingError
from esfo_core.events import EventArray
from esfo_core.packets import EVENT_PACKET
from esfo_core.recordings.bag_writer import BagTopic, BagWriter
from esfo_core.recordings.messages import CAMERA_INFO, header, info_from_camera, typestore

EVENTS_TOPIC = "/events"
CAMERA_TOPIC = "/camera_info"
FRAME = "camera"

PACKET_NS = 2_000_000
PACKET_EVENTS = 8192  # of at most 8 bytes each: 64 KiB

LATEST = 2**31 * 10**9 - 1
"""Last time that `builtin_interfaces/Time` holds, ns."""


def write_mcap(
    path: Path,
    chunks: Iterable[EventArray],
    camera: Camera | tuple[int, int],
    encoding: str = "mono",
    round_times: bool = False,
    host_offset: int = 0,
) -> int:
    """Write time-sorted chunks of events, one after the other, as a ROS 2 bag of one file; return their number.

    Topics: `/camera_info` (`sensor_msgs/CameraInfo`, first, latched) and `/events`
    (`event_camera_msgs/EventPacket`, packets of at most 2 ms and 8192 events). A packet is stamped with its first event
    and logged at its last one. The same input gives the same bytes.

    camera: or the size (width, height) of an uncalibrated sensor; then there is no `/camera_info`. encoding: `mono`, or
    `evt3`, which mostly takes less room but has whole microseconds and up to 2048 columns and rows.
    round_times: round times down to what the encoding holds; otherwise one that does not fit is an error.
    host_offset: host time minus sensor time, ns; stamps and log times are host times.

    Raises RecordingError when there is no event, time steps back or is negative, a pixel lies outside the sensor, the
    encoding is unknown or cannot hold an event, or the file cannot be written. Until the last event is written the file
    is called `<path>.part`.
    """
    with BagWriter(path) as bag:
        return _write(bag, chunks, camera, _Form(encoding, encoder(encoding, round_times), host_offset))


@dataclass(frozen=True)
class _Form:
    """How packets are written: the encoding by its name and as a function, and host minus sensor time in ns."""

    encoding: str
    encode: Callable[[EventArray], tuple[int, bytes]]
    host_offset: int


def _write(bag: BagWriter, chunks: Iterable[EventArray], camera: Camera | tuple[int, int], form: _Form) -> int:
    store = typestore()
    packet_type = store.types[EVENT_PACKET]
    width, height = (camera.width, camera.height) if isinstance(camera, Camera) else camera
    if isinstance(camera, Camera):
        info_topic = bag.add_topic(_topic(CAMERA_TOPIC, CAMERA_INFO, depth=1, latched=True))
    event_topic = bag.add_topic(_topic(EVENTS_TOPIC, EVENT_PACKET, depth=1000, latched=False))
    count = 0
    for seq, events in enumerate(_split(_checked(chunks, (width, height), form.host_offset))):
        first, last = (int(events["t"][i]) + form.host_offset for i in (0, -1))
        if seq == 0 and isinstance(camera, Camera):
            info = store.serialize_cdr(info_from_camera(camera, first, FRAME), CAMERA_INFO)
            bag.write(info_topic, first, bytes(info))
        time_base, data = form.encode(events)
        packet = packet_type(
            header=header(first, FRAME),
            height=height,
            width=width,
            seq=seq,
            time_base=time_base,
            encoding=form.encoding,
            is_bigendian=False,
            events=np.frombuffer(data, np.uint8),
        )
        bag.write(event_topic, last, bytes(store.serialize_cdr(packet, EVENT_PACKET)), seq)
        count += len(events)
    if not count:
        raise RecordingError("no events to write")
    return count


def _topic(name: str, kind: str, depth: int, latched: bool) -> BagTopic:
    store = typestore()
    definition, _ = store.generate_msgdef(kind, ros_version=2)
    return BagTopic(name, kind, definition, store.hash_rihs01(kind), depth, latched)


def _checked(chunks: Iterable[EventArray], size: tuple[int, int], host_offset: int) -> Iterator[EventArray]:
    latest = 0
    for events in chunks:
        if not len(events):
            continue
        times = events["t"]
        if times[0] < latest or (times[1:] < times[:-1]).any():
            raise RecordingError(f"events are not in time order, or negative, after {latest} ns")
        if events["x"].max() >= size[0] or events["y"].max() >= size[1]:
            raise RecordingError(f"pixel ({events['x'].max()}, {events['y'].max()}) lies outside {size[0]}x{size[1]}")
        latest = int(times[-1])
        if not 0 <= int(times[0]) + host_offset <= latest + host_offset <= LATEST:
            raise RecordingError(f"time {latest + host_offset} ns does not fit a ROS time stamp (at most {LATEST} ns)")
        yield events


def _split(chunks: Iterable[EventArray]) -> Iterator[EventArray]:
    """Cut chunks into packets of at most `PACKET_NS` and `PACKET_EVENTS`."""
    for events in chunks:
        start = 0
        while start < len(events):
            by_time = int(np.searchsorted(events["t"], events["t"][start] + PACKET_NS))
            end = min(by_time, start + PACKET_EVENTS)
            yield events[start:end]
            start = end
