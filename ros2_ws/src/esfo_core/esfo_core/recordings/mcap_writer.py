"""Writing a ROS 2 bag: one self-contained MCAP file with events and camera."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer

from esfo_core.camera import Camera
from esfo_core.codecs import encode_mono
from esfo_core.errors import RecordingError
from esfo_core.events import EventArray
from esfo_core.recordings.messages import CAMERA_INFO, EVENT_PACKET, header, info_from_camera, typestore

EVENTS_TOPIC = "/events"
CAMERA_TOPIC = "/camera_info"
FRAME = "camera"
LIBRARY = "esfo_core"

PACKET_NS = 2_000_000
PACKET_EVENTS = 8192  # 64 KiB of 8 bytes

LATEST = 2**31 * 10**9 - 1
"""Last time that `builtin_interfaces/Time` holds, ns."""

_FOREVER = "{sec: 9223372036, nsec: 854775807}"


def write_mcap(path: Path, chunks: Iterable[EventArray], camera: Camera) -> int:
    """Write time-sorted chunks of events, one after the other, as a ROS 2 bag of one file; return their number.

    Topics: `/camera_info` (`sensor_msgs/CameraInfo`, first, latched) and `/events`
    (`event_camera_msgs/EventPacket`, encoding `mono`, packets of at most 2 ms and 64 KiB). A packet is stamped with its
    first event and logged at its last one, in sensor time without an offset. The same input gives the same bytes.

    Raises RecordingError when there is no event, time steps back or is negative, a pixel lies outside the sensor, or
    the file cannot be written. Until the last event is written the file is called `<path>.part`.
    """
    part = path.with_name(path.name + ".part")
    try:
        with part.open("wb") as file:
            writer = Writer(file, compression=CompressionType.NONE)
            writer.start(profile="ros2", library=LIBRARY)
            count = _write(writer, chunks, camera)
            writer.finish()  # type: ignore[no-untyped-call]
        part.replace(path)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
    finally:
        if part.exists():
            part.unlink()
    return count


def _write(writer: Writer, chunks: Iterable[EventArray], camera: Camera) -> int:
    store = typestore()
    packet_type = store.types[EVENT_PACKET]
    info_channel = _add_topic(writer, CAMERA_TOPIC, CAMERA_INFO, latched=True)
    event_channel = _add_topic(writer, EVENTS_TOPIC, EVENT_PACKET, latched=False)
    count = 0
    for seq, events in enumerate(_split(_checked(chunks, camera))):
        first, last = int(events["t"][0]), int(events["t"][-1])
        if seq == 0:
            info = store.serialize_cdr(info_from_camera(camera, first, FRAME), CAMERA_INFO)
            writer.add_message(info_channel, first, bytes(info), first)
        packet = packet_type(
            header=header(first, FRAME),
            height=camera.height,
            width=camera.width,
            seq=seq,
            time_base=first,
            encoding="mono",
            is_bigendian=False,
            events=np.frombuffer(encode_mono(events, first), np.uint8),
        )
        writer.add_message(event_channel, last, bytes(store.serialize_cdr(packet, EVENT_PACKET)), last, seq)
        count += len(events)
    if not count:
        raise RecordingError("no events to write")
    return count


def _add_topic(writer: Writer, topic: str, kind: str, latched: bool) -> int:
    store = typestore()
    schema = writer.register_schema(kind, "ros2msg", store.generate_msgdef(kind, ros_version=2)[0].encode())
    qos = (
        f"- {{history: keep_last, depth: {1 if latched else 1000}, reliability: reliable, "
        f"durability: {'transient_local' if latched else 'volatile'}, deadline: {_FOREVER}, lifespan: {_FOREVER}, "
        f"liveliness: automatic, liveliness_lease_duration: {_FOREVER}, avoid_ros_namespace_conventions: false}}\n"
    )
    metadata = {"offered_qos_profiles": qos, "topic_type_hash": store.hash_rihs01(kind)}
    return writer.register_channel(topic, "cdr", schema, metadata)


def _checked(chunks: Iterable[EventArray], camera: Camera) -> Iterator[EventArray]:
    latest = 0
    for events in chunks:
        if not len(events):
            continue
        times = events["t"]
        if times[0] < latest or (times[1:] < times[:-1]).any():
            raise RecordingError(f"events are not in time order, or negative, after {latest} ns")
        if events["x"].max() >= camera.width or events["y"].max() >= camera.height:
            raise RecordingError(
                f"pixel ({events['x'].max()}, {events['y'].max()}) lies outside {camera.width}x{camera.height}"
            )
        latest = int(times[-1])
        if latest > LATEST:
            raise RecordingError(f"time {latest} ns does not fit a ROS time stamp (at most {LATEST} ns)")
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
