"""Writing MCAP and reading it back, with this package and with readers that know nothing of it."""

from __future__ import annotations

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from esfo_core.camera import Camera
from esfo_core.errors import RecordingError
from esfo_core.events import empty_events, make_events
from esfo_core.recordings import open_recording, write_mcap

CAMERA = Camera(
    346,
    260,
    np.array([[300.5, 0, 170], [0, 301, 128.25], [0, 0, 1]]),
    "plumb_bob",
    np.array([0.1, -0.2, 1e-3, 2e-3, 0]),
)


def random_events(n, seconds, start=1_700_000_000_123_456_789):
    rng = np.random.default_rng(7)
    t = start + np.sort(rng.integers(0, int(seconds * 1e9), n))
    return make_events(rng.integers(0, 346, n), rng.integers(0, 260, n), rng.integers(0, 2, n), t)


@pytest.fixture
def scene(tmp_path):
    events = random_events(50_000, 0.2)
    path = tmp_path / "scene.mcap"
    assert write_mcap(path, np.array_split(events, 9), CAMERA) == len(events)
    return path, events


def test_what_was_written_is_read(scene):
    path, events = scene
    recording = open_recording(path)
    assert (recording.width, recording.height, recording.format) == (346, 260, "ROS 2 bag (MCAP), mono")
    assert recording.size_bytes == path.stat().st_size
    camera = recording.camera
    assert (camera.width, camera.height, camera.distortion_model) == (346, 260, "plumb_bob")
    assert (camera.K == CAMERA.K).all()
    assert (camera.D == CAMERA.D).all()
    recording.wanted_segment = 0  # nothing is held back to find the largest
    for _ in range(2):  # chunks() starts anew
        progress, chunks = [], []
        for chunk in recording.chunks(5_000_000):
            chunks.append(chunk)
            progress.append(recording.progress())
        assert (np.concatenate(chunks) == events).all()
        assert len(chunks) == 40
        assert progress == sorted(progress)
        assert 0 < progress[0] < 0.5
        assert progress[-1] == 1.0
    s = recording.statistics
    assert (s.events, s.events_on) == (len(events), np.count_nonzero(events["p"]))
    assert (s.first_t, s.last_t) == (events["t"][0], events["t"][-1])
    assert s.packets_lost == s.packets_damaged == s.out_of_order == s.bytes_lost == 0


def test_other_readers_find_a_self_contained_ros2_bag(scene):
    path, events = scene
    with AnyReader([path]) as reader:  # without a typestore: only the definitions in the file
        stored = [(c.topic, t, reader.deserialize(data, c.msgtype)) for c, t, data in reader.messages()]
    assert [topic for topic, _, _ in stored[:2]] == ["/camera_info", "/events"]
    packets = [(t, m) for topic, t, m in stored if topic == "/events"]
    assert [m.seq for _, m in packets] == list(range(len(packets)))
    for t, m in packets:
        words = m.events.view("<u8")
        times = m.time_base + (words & 0xFFFFFFFF)
        assert len(m.events) <= 65536
        assert times[-1] - times[0] <= 2_000_000
        assert m.time_base == times[0] == m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
        assert t == times[-1]
        assert (m.width, m.height, m.encoding, m.is_bigendian) == (346, 260, "mono", False)
    x = np.concatenate([m.events.view("<u2")[2::4] for _, m in packets])
    assert (x == events["x"]).all()


def test_the_file_has_what_bag_info_and_players_ask_for(scene):
    path, events = scene
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        header, summary = reader.get_header(), reader.get_summary()
        assert sum(1 for _ in reader.iter_messages()) == summary.statistics.message_count
    assert header.profile == "ros2"
    schemas = {s.name: s for s in summary.schemas.values()}
    assert set(schemas) == {"event_camera_msgs/msg/EventPacket", "sensor_msgs/msg/CameraInfo"}
    assert all(s.encoding == "ros2msg" for s in schemas.values())
    assert b"MSG: builtin_interfaces/Time" in schemas["event_camera_msgs/msg/EventPacket"].data
    channels = {c.topic: c for c in summary.channels.values()}
    assert "durability: transient_local" in channels["/camera_info"].metadata["offered_qos_profiles"]
    # The hash of the public definition, as bags recorded by ROS 2 carry it.
    assert channels["/events"].metadata["topic_type_hash"] == (
        "RIHS01_d6fa176260b1f37e5a40845305315e150a0f18191241eb64f407442aa29844aa"
    )
    assert summary.statistics.message_start_time == events["t"][0]
    assert summary.statistics.message_end_time == events["t"][-1]
    assert summary.chunk_indexes


def test_the_same_events_give_the_same_bytes_however_they_arrive(tmp_path):
    events = random_events(3000, 0.02, start=0)
    a, b = tmp_path / "a.mcap", tmp_path / "b.mcap"
    write_mcap(a, [events], CAMERA)
    write_mcap(b, iter([events.copy(), empty_events()]), CAMERA)
    assert a.read_bytes() == b.read_bytes()


def test_long_gaps_and_dense_moments_fit_packets(tmp_path):
    dense = random_events(40_000, 1e-3, start=5)
    late = random_events(10, 1e-3, start=10**13)
    path = tmp_path / "gap.mcap"
    write_mcap(path, [dense, late], CAMERA)
    with AnyReader([path]) as reader:
        sizes = [
            len(reader.deserialize(data, c.msgtype).events) for c, _, data in reader.messages(reader.connections[1:])
        ]
    assert sizes == [65536] * 4 + [8 * 40_000 - 4 * 65536, 8 * 10]
    assert (np.concatenate(list(open_recording(path).chunks())) == np.concatenate([dense, late])).all()


@pytest.mark.parametrize(
    ("events", "message"),
    [
        ([], "no events to write"),
        ([random_events(5, 1)[::-1]], "not in time order"),
        ([random_events(5, 1), random_events(5, 1)], "not in time order"),
        ([random_events(5, 1, start=-(10**10))], "negative"),
        ([random_events(5, 1, start=2**31 * 10**9)], "does not fit a ROS time stamp"),
        ([make_events(np.array([346]), np.array([0]), np.array([0]), np.array([0]))], r"pixel \(346, 0\)"),
    ],
)
def test_impossible_events_are_refused_and_leave_no_file(tmp_path, events, message):
    kept = tmp_path / "scene.mcap"
    kept.write_bytes(b"earlier")
    with pytest.raises(RecordingError, match=message):
        write_mcap(kept, events, CAMERA)
    assert [p.name for p in tmp_path.iterdir()] == ["scene.mcap"]
    assert kept.read_bytes() == b"earlier"


@pytest.mark.parametrize("name", ["missing/scene.mcap", "file/scene.mcap", "folder"])
def test_a_path_that_cannot_be_written_is_one_error(tmp_path, name):
    (tmp_path / "file").write_bytes(b"")
    (tmp_path / "folder").mkdir()
    with pytest.raises(RecordingError, match=name):
        write_mcap(tmp_path / name, [random_events(5, 1)], CAMERA)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]


def test_evt3_holds_the_same_events_in_less_room(tmp_path):
    events = random_events(50_000, 0.2)
    events["t"] -= events["t"] % 1000
    events = events[np.argsort(events["t"], kind="stable")]
    sizes = {}
    for encoding in ("mono", "evt3"):
        path = tmp_path / f"{encoding}.mcap"
        assert write_mcap(path, np.array_split(events, 9), CAMERA, encoding) == len(events)
        recording = open_recording(path)
        assert recording.format == f"ROS 2 bag (MCAP), {encoding}"
        assert (np.concatenate(list(recording.chunks())) == events).all()
        assert recording.statistics.host_offset == 0
        sizes[encoding] = path.stat().st_size
    assert sizes["evt3"] < 0.85 * sizes["mono"]  # three words at most for events that share no row
    with pytest.raises(RecordingError, match="no whole microsecond"):
        write_mcap(path, [random_events(100, 0.2)], CAMERA, "evt3")
    write_mcap(path, [random_events(100, 0.2)], CAMERA, "evt3", round_times=True)
    expected = random_events(100, 0.2)["t"] // 1000 * 1000
    assert (np.concatenate(list(open_recording(path).chunks()))["t"] == expected).all()


def test_host_times_are_stamps_and_log_times(tmp_path):
    path, offset = tmp_path / "host.mcap", 1_700_000_000 * 10**9
    events = random_events(1000, 0.01, start=5_000)
    write_mcap(path, [events], CAMERA, host_offset=offset)
    recording = open_recording(path)
    assert (np.concatenate(list(recording.chunks())) == events).all()
    assert recording.statistics.host_offset == offset
    with AnyReader([path]) as reader:
        assert reader.start_time == offset + events["t"][0]
    with pytest.raises(RecordingError, match="does not fit a ROS time stamp"):
        write_mcap(path, [events], CAMERA, host_offset=2**31 * 10**9)
    with pytest.raises(RecordingError, match="does not fit a ROS time stamp"):
        write_mcap(path, [events], CAMERA, host_offset=-(10**9))


def test_an_uncalibrated_sensor_has_no_camera_info(tmp_path):
    path = tmp_path / "bare.mcap"
    write_mcap(path, [random_events(100, 0.01)], (400, 300))
    recording = open_recording(path)
    assert (recording.width, recording.height, recording.camera) == (400, 300, None)
    with AnyReader([path]) as reader:
        assert [c.topic for c in reader.connections] == ["/events"]
