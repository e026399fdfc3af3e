"""The files that benchmarks/reading.py reads, one of each form."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from esfo_core.codecs import encoder
from esfo_core.codecs.event_array import CDR_STRIDE, ROS1_EVENT, cdr_size
from esfo_core.events import EventArray, make_events
from esfo_core.packets import EVENT_PACKET
from esfo_core.recordings import open_recording, write_mcap
from esfo_core.recordings.bag_file import BagFile

WIDTH, HEIGHT = 1280, 720
PACKET = 8192
DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
RECORDED = (
    "ros_bags/libcaer_cmp_ros2_mcap",
    "ros_bags/libcaer_rollover_ros2_db3",
    "raw/evt2.raw",
    "raw/davis346.aedat4",
)
ARRAY = "dvs_msgs/msg/EventArray"
EVENT_DEFINITION = "uint16 x\nuint16 y\nbuiltin_interfaces/Time ts\nbool polarity\n"
ARRAY_DEFINITION = "std_msgs/Header header\nuint32 height\nuint32 width\ndvs_msgs/Event[] events\n"

Packets = list[tuple[int, bytes]]


@dataclass(frozen=True)
class Case:
    """One form of recording. packets: time bases and data for the decoder of `encoding`, empty where it has none."""

    name: str
    path: Path
    encoding: str
    size: tuple[int, int]
    packets: Packets


def scattered(count: int) -> EventArray:
    """Single events all over the sensor, 5 Mev/s in whole microseconds."""
    rng = np.random.default_rng(1)
    t = np.sort(rng.integers(0, count // 5, count)) * 1000
    return make_events(rng.integers(0, WIDTH, count), rng.integers(0, HEIGHT, count), rng.integers(0, 2, count), t)


def rows(count: int) -> EventArray:
    """Runs of 16 columns of one row, as a sensor sends them from moving edges, 20 Mev/s."""
    rng = np.random.default_rng(2)
    runs = count // 16
    x = rng.integers(0, WIDTH - 16, runs)[:, None] + np.arange(16)
    y, p = rng.integers(0, HEIGHT, runs), rng.integers(0, 2, runs)
    t = np.sort(rng.integers(0, count // 20, runs)) * 1000
    return make_events(x.ravel(), np.repeat(y, 16), np.repeat(p, 16), np.repeat(t, 16))


def split(events: EventArray) -> list[EventArray]:
    """Packets of `PACKET` events."""
    return [events[start : start + PACKET] for start in range(0, len(events), PACKET)]


def bag(folder: Path, name: str, events: EventArray, encoding: str) -> Case:
    """An MCAP of event packets."""
    path = folder / f"{name}.mcap"
    write_mcap(path, split(events), (WIDTH, HEIGHT), encoding)
    encode = encoder(encoding)
    return Case(name, path, encoding, (WIDTH, HEIGHT), [encode(part) for part in split(events)])


def raw(folder: Path, events: EventArray) -> Case:
    """A Prophesee RAW file of EVT3."""
    path, encode = folder / "file.raw", encoder("evt3")
    data = b"".join(encode(part)[1] for part in split(events))
    path.write_bytes(f"% format EVT3\n% geometry {WIDTH}x{HEIGHT}\n% end\n".encode() + data)
    blocks = [(0, data[start : start + (1 << 20)]) for start in range(0, len(data), 1 << 20)]
    return Case("RAW evt3, scattered", path, "evt3", (WIDTH, HEIGHT), blocks)


def dat(folder: Path, events: EventArray) -> Case:
    """A Prophesee DAT file."""
    path = folder / "file.dat"
    words = np.empty((len(events), 2), "<u4")
    words[:, 0] = events["t"] // 1000
    words[:, 1] = events["x"] | events["y"].astype("<u4") << 14 | events["p"].astype("<u4") << 28
    data = words.tobytes()
    path.write_bytes(f"% Version 2\n% Width {WIDTH}\n% Height {HEIGHT}\n% end\n".encode() + b"\x0c\x08" + data)
    blocks = [(0, data[start : start + (1 << 20)]) for start in range(0, len(data), 1 << 20)]
    return Case("DAT", path, "dat", (WIDTH, HEIGHT), blocks)


def cdr_events(events: EventArray) -> bytes:
    """The sequence of an event array in CDR, without its length."""
    data = np.zeros(CDR_STRIDE * (len(events) + 1), np.uint8)
    slots = data[:-CDR_STRIDE].reshape(-1, CDR_STRIDE)  # x and y of all but the first lie two bytes before these
    slots[:, 4:12].view("<u4")[:] = np.stack(np.divmod(events["t"], 10**9), axis=1)
    slots[:, 12] = events["p"]
    pixels = np.stack([events["x"], events["y"]], axis=1).astype("<u2")
    data[:4] = pixels[:1].view(np.uint8).ravel()
    data[14 : 14 + CDR_STRIDE * (len(events) - 1)].reshape(-1, CDR_STRIDE)[:, :4] = pixels[1:].view(np.uint8)
    return data[: cdr_size(len(events))].tobytes()


def ros1_events(events: EventArray) -> bytes:
    """The array of an event array in ROS 1, without its length."""
    packed = np.empty(len(events), ROS1_EVENT)
    packed["x"], packed["y"], packed["p"] = events["x"], events["y"], events["p"]
    packed["sec"], packed["nanosec"] = np.divmod(events["t"], 10**9)
    return packed.tobytes()


def event_arrays(folder: Path, events: EventArray, ros1: bool) -> Case:
    """A ROS 1 or ROS 2 bag of `dvs_msgs/EventArray`."""
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(EVENT_DEFINITION, "dvs_msgs/msg/Event"))
    store.register(get_types_from_msg(ARRAY_DEFINITION, ARRAY))
    start = (bytes(16) if ros1 else b"\0\1\0\0" + bytes(8) + np.array([1, 0], "<u4").tobytes()) + np.array(
        [HEIGHT, WIDTH], "<u4"
    ).tobytes()
    packets = [(0, (ros1_events if ros1 else cdr_events)(part)) for part in split(events)]
    messages = [
        start + np.array([len(part)], "<u4").tobytes() + data
        for part, (_, data) in zip(split(events), packets, strict=True)
    ]
    path = folder / f"arrays.{'bag' if ros1 else 'mcap'}"
    if ros1:
        with Rosbag1Writer(path) as writer:
            connection = writer.add_connection("/events", ARRAY, typestore=store)
            for i, message in enumerate(messages):
                writer.write(connection, i, message)
    else:
        write_ros2_arrays(path, store, messages)
    encoding = "ros1_event_array" if ros1 else "cdr_event_array"
    return Case(f"EventArray, ROS {1 if ros1 else 2}", path, encoding, (WIDTH, HEIGHT), packets)


def write_ros2_arrays(path: Path, store: Any, messages: list[bytes]) -> None:
    """Write serialised event arrays as an MCAP."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros2")
        schema = writer.register_schema(ARRAY, "ros2msg", store.generate_msgdef(ARRAY, ros_version=2)[0].encode())
        channel = writer.register_channel("/events", "cdr", schema)
        for i, message in enumerate(messages):
            writer.add_message(channel, i, message, i)
        writer.finish()  # type: ignore[no-untyped-call]


def text(folder: Path, events: EventArray) -> Case:
    """A comma-separated text of x, y, p, t in microseconds."""
    path = folder / "file.csv"
    columns = np.stack([events["x"], events["y"], events["p"], events["t"] // 1000], axis=1)
    np.savetxt(path, columns, "%d", ",", header="x,y,p,t", comments="")
    return Case("CSV", path, "", (0, 0), [])


def numpy_file(folder: Path, events: EventArray) -> Case:
    """A NumPy file of a structured array, times in nanoseconds."""
    path = folder / "file.npy"
    np.save(path, events)
    return Case("NumPy, structured", path, "", (0, 0), [])


def event_stream(folder: Path, events: EventArray) -> Case:
    """An Event Stream file of DVS events."""
    path = folder / "file.es"
    steps = np.diff(events["t"] // 1000, prepend=0)
    count = len(events)
    words = np.empty((count, 5), np.uint8)
    words[:, 0] = steps << 1 | events["p"]  # fewer than 127 us from one event to the next
    words[:, 1:3] = events["x"][:, None].astype("<u2").view(np.uint8)
    words[:, 3:5] = (HEIGHT - 1 - events["y"])[:, None].astype("<u2").view(np.uint8)
    size = np.array([WIDTH, HEIGHT], "<u2").tobytes()
    path.write_bytes(b"Event Stream\2\0\0\1" + size + words.tobytes())
    return Case("Event Stream", path, "", (0, 0), [])


def recorded(name: str) -> Iterator[Case]:
    """A recording beside the repository, where it is there."""
    path = DATA / name
    if not path.exists():
        return
    recording = open_recording(path)
    packets: Packets = []
    if path.is_dir():
        file = BagFile(next(p for p in path.iterdir() if p.suffix in (".mcap", ".db3")))
        topic = next(topic for topic, _ in file.topics([EVENT_PACKET]))
        packets = [(m.time_base, bytes(m.data)) for m in file.messages(topic, EVENT_PACKET)]
    encoding = recording.format.rpartition(", ")[2]
    yield Case(
        f"{encoding if packets else recording.format}, recorded",
        path,
        encoding,
        (recording.width, recording.height),
        packets,
    )


def all_cases(folder: Path, count: int) -> list[Case]:
    """One case of every form, made in `folder` from about `count` events; CSV from a fifth of them."""
    single, runs = scattered(count), rows(count)
    cases = [bag(folder, "mono", single, "mono")]
    cases += [bag(folder, "evt3, scattered", single, "evt3"), bag(folder, "evt3, rows", runs, "evt3")]
    cases += [raw(folder, single), dat(folder, single)]
    cases += [event_arrays(folder, single, ros1) for ros1 in (True, False)]
    cases += [text(folder, single[: count // 5]), numpy_file(folder, single), event_stream(folder, single)]
    cases += [case for path in RECORDED for case in recorded(path)]
    return cases


def large_file(path: Path, gigabytes: float) -> int:
    """Write a long recording of one scene over and over, as a bag or RAW by the extension; return its events."""
    scene = scattered(1 << 20)
    length, count = int(scene["t"][-1]) + 1000, 0

    def repeats(copies: int) -> Iterator[EventArray]:
        for i in range(copies):
            chunk = scene.copy()
            chunk["t"] += i * length
            yield chunk

    if path.suffix == ".mcap":
        return write_mcap(path, repeats(int(gigabytes * 1e9 / 8 / len(scene)) + 1), (WIDTH, HEIGHT))
    encode = encoder("evt3")
    with path.open("wb") as file:
        file.write(f"% format EVT3\n% geometry {WIDTH}x{HEIGHT}\n% end\n".encode())
        for chunk in repeats(1 << 20):
            count += len(chunk)
            file.write(encode(chunk)[1])
            if file.tell() > gigabytes * 1e9:
                return count
    raise AssertionError("the scene is too short")
