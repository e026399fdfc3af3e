"""result.mcap of a run: read back by two readers that know nothing of it, against the other results and the events."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from esfo_bringup.cli import main
from esfo_bringup.replay.messages import packet_message
from esfo_bringup.replay.player import packets
from esfo_bringup.result_bag.cdr import serialise
from esfo_core.activity import Activity
from esfo_core.activity_pyramid import BINS as PYRAMID_BINS
from esfo_core.orbit import Spin, object_frame
from esfo_core.recordings import open_recording
from esfo_core.tracks import Tracks
from esfo_frontend.overlay import BACKGROUND, COLOURS, HEAD, LINE, TRAIL

DOCUMENT = Path(__file__).parents[2] / "docs/interfaces.md"
SMALL = ["-p", "width:=240", "-p", "height:=180", "--view", "diagonal", "--speed", "fast", "--revolutions", "2.2"]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "scene.mcap"
    assert main(["simulate", *SMALL, "-o", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def folder(scene):
    out = scene.parent / "out"
    assert main(["run", str(scene), "-o", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def bag(folder):
    """All messages by topic, each with its log time, decoded by the definitions in the bag."""
    found = {}
    with AnyReader([folder / "result.mcap"]) as reader:
        times = []
        for connection, t, data in reader.messages():
            found.setdefault(connection.topic, []).append((t, reader.deserialize(data, connection.msgtype)))
            times.append(t)
    assert times == sorted(times)
    return found


def test_the_report_has_all_pictures(folder):
    page = (folder / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 2
    orbit = json.loads((folder / "orbit.json").read_text())
    assert f"{orbit['spin_rate_hz']:.6f} Hz" in page
    assert f"{orbit['spin_rate_slope_hz_s']:+.2e} Hz/s" in page
    assert "in orbit radii" in page
    assert orbit["versions"]["numba"] in page


def documented_topics():
    """Topics of docs/interfaces.md that a run through the nodes publishes: name, type, whether latched, and depth."""
    topics = {"/diagnostics": ("diagnostic_msgs/msg/DiagnosticArray", False, 10)}
    for row in DOCUMENT.read_text().splitlines():
        match = re.match(
            r"\| `(\S+)` \| `(\w+)/(\w+)` \| (?:frontend|backend|replay) -> \| (reliable.*keep last (\d+)) \|", row
        )
        if match:
            name, package, kind, qos, depth = match.groups()
            topics["/" + name.lstrip("/")] = (f"{package}/msg/{kind}", "latched" in qos, int(depth))
    del topics["/clock"]  # whoever plays the bag publishes it
    return topics


def test_the_bag_has_every_topic_as_documented(folder):
    with (folder / "result.mcap").open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
        topics = {}
        for channel in summary.channels.values():
            schema = summary.schemas[channel.schema_id]
            assert (channel.message_encoding, schema.encoding) == ("cdr", "ros2msg")
            (qos,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
            assert (qos["reliability"], qos["history"]) == ("reliable", "keep_last")
            topics[channel.topic] = (schema.name, qos["durability"] == "transient_local", qos["depth"])
        counts = {summary.channels[n].topic: count for n, count in summary.statistics.channel_message_counts.items()}
    assert topics == documented_topics()
    assert set(counts) == set(topics)
    assert min(counts.values()) >= 2


def test_the_orbit_is_that_of_the_other_results(folder, bag):
    orbit = json.loads((folder / "orbit.json").read_text())
    first, last = bag["/events"][0][0], bag["/events"][-1][0]
    for topic in ("/orbit", "/spin_rate", "/markers", "/camera_info"):
        (begin, early), (end, late) = bag[topic]
        assert begin - first <= 0
        assert end >= last
        assert str(early) == str(late)
    message = bag["/orbit"][0][1]
    assert message.rate_hz == orbit["spin_rate_hz"]
    assert message.rate_std_hz == orbit["spin_rate_std_hz"]
    assert message.axis.tolist() == orbit["axis"]
    assert message.center.tolist() == orbit["center"]
    assert (message.status, message.flags, message.t0) == (0, orbit["flags"], orbit["t0_ns"])
    assert (message.points, message.tracks, message.observations) == tuple(
        orbit[name] for name in ("points", "tracks", "observations")
    )
    w = bag["/spin_rate"][0][1].twist.twist.angular
    np.testing.assert_allclose([w.x, w.y, w.z], 2 * np.pi * orbit["spin_rate_hz"] * np.array(orbit["axis"]))


def pose(transform):
    """Rotation (3, 3) and translation (3,) of a transform."""
    q, p = transform.rotation, transform.translation
    matrix = trimesh.transformations.quaternion_matrix([q.w, q.x, q.y, q.z])
    return matrix[:3, :3], np.array([p.x, p.y, p.z])


def stamp(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_points_and_pose_move_as_the_orbit_says(folder, bag):
    orbit = json.loads((folder / "orbit.json").read_text())
    spin = Spin(np.array(orbit["axis"]), orbit["spin_rate_hz"], np.array(orbit["center"]), orbit["t0_ns"])
    points = np.asarray(trimesh.load(folder / "points.ply").vertices)
    poses = {stamp(m.transforms[0]): m.transforms[0] for _, m in bag["/tf"]}
    times = np.array(sorted(poses))
    assert np.diff(times).max() <= 33_333_334
    assert times[0] <= bag["/events"][0][0]
    assert times[-1] >= bag["/events"][-1][0]
    assert len(bag["/points"]) > 0.25 * len(poses)
    for _, cloud in bag["/points"]:
        transform = poses[stamp(cloud)]
        assert (transform.header.frame_id, transform.child_frame_id) == ("camera", cloud.header.frame_id)
        xyz = np.frombuffer(cloud.data.tobytes(), "<f4").reshape(-1, 5)[:, :3]
        R, p = pose(transform.transform)
        np.testing.assert_allclose(xyz @ R.T + p, spin.transform(points, stamp(cloud)), atol=1e-6)
        np.testing.assert_allclose(xyz @ object_frame(spin.axis).T, points, atol=1e-6)


def test_the_events_are_those_of_the_recording_in_the_packets_of_the_replay(scene, folder):
    source = open_recording(scene)
    copy = open_recording(folder / "result.mcap")
    assert (np.concatenate(list(copy.chunks())) == np.concatenate(list(source.chunks()))).all()
    assert (copy.camera.K == source.camera.K).all()
    expected = [serialise(packet_message(p, k, (240, 180), "camera")) for k, p in enumerate(packets(source, False))]
    with (folder / "result.mcap").open("rb") as file:
        found = [m.data for _, _, m in make_reader(file).iter_messages(topics=["/events"])]
    assert found == expected


def test_tracks_corners_and_activity_are_complete(scene, folder, bag):
    tracks = [m for _, m in bag["/feature_tracks"]]
    uv = np.concatenate([np.stack([m.u, m.v], axis=1) for m in tracks])
    columns = [np.concatenate([getattr(m, name) for m in tracks]) for name in ("track_id", "t", "sigma")]
    found = Tracks.from_columns(columns[0], columns[1], uv, columns[2]).sorted()
    written = Tracks.read_csv(folder / "tracks.csv")
    for column in ("track_id", "t", "uv", "sigma"):
        assert (getattr(found, column) == getattr(written, column)).all()
    assert sorted(np.concatenate([m.ended for m in tracks])) == np.unique(written.track_id).tolist()
    corners = [m for _, m in bag["/corner_clusters"]]
    assert {t for m in corners for t in m.cluster_id.tolist()} - {-1} <= set(written.track_id.tolist())
    events = np.concatenate(list(open_recording(scene).chunks()))
    times = np.concatenate([m.t for m in corners])
    assert np.isin(times, events["t"]).all()
    bins = [m for _, m in bag["/event_activity"] if m.bin not in PYRAMID_BINS]
    counts = np.concatenate([m.counts.reshape(-1, 2, m.rows, m.columns) for m in bins])
    m = bins[0]
    twin = Activity.from_events(events, m.t0, len(counts), m.bin, m.cell, (m.rows, m.columns))
    assert (counts == twin.counts).all()
    pyramid = [m for _, m in bag["/event_activity"] if m.bin in PYRAMID_BINS]
    assert len({m.bin for m in pyramid}) > 8


def test_the_overlay_shows_events_tracks_and_line(scene, bag):
    events = np.concatenate(list(open_recording(scene).chunks()))
    images = bag["/overlay"]
    times = np.array([stamp(m) for _, m in images])
    assert 10 <= 1e9 / np.diff(times).mean() <= 30
    assert times[-1] == events["t"][-1]
    shown = np.zeros(3, int)
    for (_, image), before in zip(images[1:], times, strict=False):
        rgb = image.data.reshape(180, 240, 3)
        window = events[(events["t"] >= before) & (events["t"] < stamp(image) + (stamp(image) == times[-1]))]
        expected = np.full((180, 240, 3), BACKGROUND, np.uint8)
        for e in window:
            expected[e["y"], e["x"]] = COLOURS[e["p"]]
        drawn = [(rgb == colour).all(axis=2) for colour in (TRAIL, HEAD, LINE)]
        free = ~np.any(drawn, axis=0)
        assert (rgb[free] == expected[free]).all()
        shown += [d.sum() for d in drawn]
    assert (shown > 100).all()


def test_diagnostics_tell_verdict_and_stream(bag):
    by_name = {}
    for _, message in bag["/diagnostics"]:
        for status in message.status:
            by_name.setdefault(status.name, []).append({v.key: v.value for v in status.values})
    assert [v["status"] for v in by_name["/backend"]] == ["ok", "ok"]
    assert len(by_name["/frontend"]) >= 2
    assert float(by_name["/frontend"][0]["Mev/s in"]) > 0


def test_a_bag_can_be_run_again_and_gives_the_same_bag(scene, folder, capsys):
    assert main(["info", str(folder / "result.mcap")]) == 0
    assert "240x180" in capsys.readouterr().out
    again = scene.parent / "again"
    assert main(["run", str(folder / "result.mcap"), "-o", str(again)]) == 0
    one, two = (json.loads((f / "orbit.json").read_text()) for f in (folder, again))
    for orbit in (one, two):
        del orbit["timing_s"]
    assert one == two
    assert (again / "result.mcap").read_bytes() == (folder / "result.mcap").read_bytes()


def test_the_recording_is_not_overwritten(folder, capsys):
    before = (folder / "result.mcap").read_bytes()
    assert main(["run", str(folder / "result.mcap"), "-o", str(folder), "--bag", "no-events"]) == 1
    assert "choose another folder" in capsys.readouterr().err
    assert main(["live", str(folder / "result.mcap"), "-o", str(folder)]) == 1
    assert "choose another folder" in capsys.readouterr().err
    assert (folder / "result.mcap").read_bytes() == before
