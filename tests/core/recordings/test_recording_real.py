"""Real recordings decode to the counts and sums that their publishers state."""

from __future__ import annotations

import numpy as np
import pytest
from recording_truth import TRUTHS, recording

from esfo_core.codecs import decoder
from esfo_core.packets import EVENT_PACKET
from esfo_core.recordings import open_recording
from esfo_core.recordings.bag_file import BagFile


def read(name):
    r = open_recording(recording(name))
    return r, np.concatenate(list(r.chunks()))


@pytest.mark.parametrize("truth", TRUTHS, ids=lambda t: t.name)
def test_counts(truth):
    r, events = read(truth.name)
    s = r.statistics
    assert (r.encoding, r.width, r.height, r.camera) == (truth.encoding, truth.width, truth.height, None)
    assert (s.events, s.events_on) == (truth.off + truth.on, truth.on)
    assert np.bincount(events["p"]).tolist() == [truth.off, truth.on]
    assert (np.diff(events["t"]) >= 0).all()
    assert (s.last_t - s.first_t) / 1e9 == pytest.approx(truth.duration, abs=5e-4)
    assert (s.decoder.triggers_rising, s.decoder.triggers_falling) == truth.triggers
    assert truth.packets in (None, s.packets)
    assert s.packets_lost == s.packets_damaged == s.out_of_order == s.bytes_lost == 0
    d = s.decoder
    assert d.out_of_range == d.unsynchronised == d.unknown_words == d.trailing_bytes == d.out_of_order == 0
    assert r.progress() == 1.0


@pytest.mark.parametrize(
    ("name", "x", "y", "t"),
    [
        ("ros_bags/evt3_trigger_ros2_db3", 42_078_718, 31_656_267, 1_222_326_831_810_000),
        ("ros_bags/libcaer_rollover_ros2_db3", 111_651_612, 82_801_007, 15_762_826_572_202_229_126),
    ],
)
def test_sums_of_the_reference_decoder(name, x, y, t):
    _, events = read(name)
    assert int(events["x"].sum(dtype=np.int64)) == x
    assert int(events["y"].sum(dtype=np.int64)) == y
    assert int(events["t"].astype(np.uint64).sum()) == t  # modulo 2^64, as the reference sums


def test_times_of_events_and_triggers_together():
    path = recording("ros_bags/evt3_ros1.bag")
    d, total, edges = decoder("evt3", 640, 480), 0, []
    for message in BagFile(path).messages("/event_camera/events", EVENT_PACKET):
        total += int(d.decode(message.data)["t"].sum()) + int(d.triggers["t"].sum())
        edges += d.triggers["edge"].tolist()
    assert total == 2_885_601_049_874 * 1000
    assert edges == [1, 0] * 2078 + [1]


def test_first_time_of_libcaer_cmp():
    _, events = read("ros_bags/libcaer_cmp_ros2_mcap")
    assert events["t"][0] == 1_744_227_144_732_712_000


def test_two_formats_of_one_bag_agree():
    _, a = read("ros_bags/evt3_ros2_db3")
    _, b = read("ros_bags/evt3_ros1.bag")
    assert (a == b).all()


def test_raw_and_dat_of_one_recording_agree():
    _, raw = read("raw/evt3.raw")
    _, dat = read("raw/gen4.dat")
    raw["t"] -= 11_194_368_000
    assert (raw == dat).all()


def test_single_files_of_a_bag_folder_open_too():
    folder = recording("ros_bags/libcaer_cmp_ros2_mcap")
    assert open_recording(folder / "test_events_2_0.mcap").encoding == "libcaer_cmp"
