"""Joining: forward only, within the radius, nearest first, one to one."""

import numpy as np

from esfo_core.events import make_events
from esfo_frontend.clustering.chunk_clusterer import SettledClusters
from esfo_frontend.clustering.cluster_joiner import ClusterJoiner
from esfo_frontend.labelled_corners import LabelledCorners
from esfo_frontend.options import JoinOptions

MS = 1_000_000
END = np.iinfo(np.int64).max


def blob(x, y, t_ms, n=6):
    """n corners at one pixel, one each 0.1 ms from t_ms on."""
    t = int(t_ms * MS) + np.arange(n) * MS // 10
    return make_events(np.full(n, x), np.full(n, y), np.ones(n), t)


def settled(blobs, until=END, open_ids=(), known=None):
    corners = np.concatenate([b for b, _ in blobs])
    ids = np.concatenate([np.full(len(b), i) for b, i in blobs])
    order = np.argsort(corners["t"], kind="stable")
    return SettledClusters(
        LabelledCorners.from_events(corners[order], ids[order]),
        until,
        frozenset(open_ids),
        until if known is None else known,
    )


def join(blobs, radius=10.0, time_scale=1000.0, size=5):
    """Return the track of every blob, all ended at once."""
    joiner = ClusterJoiner(0, time_scale, JoinOptions(radius=radius, descriptor_size=size))
    out = joiner.add(settled(blobs))
    assert joiner.idle
    assert sorted(set(out.track_id.tolist())) == out.ended
    assert len(out.corners) == sum(len(b) for b, _ in blobs)
    return [set(out.track_id[np.isin(out.corners["t"], b["t"]) & (out.corners["x"] == b["x"][0])]) for b, _ in blobs]


def test_joined_within_the_radius_and_only_there():
    # Descriptors: tail at 0.3 ms, head at t + 0.2 ms; with 3 px sideways 4 px forward make 5.
    a = blob(50, 50, 0)
    for t, same in ((4.0, True), (4.2, False)):
        first, second = join([(a, 0), (blob(53, 50, t), 1)], radius=5.0)
        assert (first == second) == same


def test_never_backward_and_never_at_the_same_time():
    first, second = join([(blob(50, 50, 5), 0), (blob(51, 50, 5), 1)])
    assert first != second


def test_nearest_first_and_one_to_one():
    tail, near, far = blob(50, 50, 0), blob(52, 50, 2), blob(57, 50, 2)
    a, b, c = join([(tail, 0), (far, 1), (near, 2)])
    assert a == c != b
    # Two tails want one head: the nearer gets it.
    a, b, c = join([(blob(50, 50, 0), 0), (blob(56, 50, 0), 1), (blob(54, 50, 2), 2)])
    assert b == c != a


def test_chain_of_three_in_one_step_is_one_track():
    tracks = join([(blob(50, 50, 0), 7), (blob(52, 50, 3), 3), (blob(54, 50, 6), 5)])
    assert tracks[0] == tracks[1] == tracks[2]


def test_time_scale_sets_the_reach_in_time():
    blobs = [(blob(50, 50, 0), 0), (blob(51, 50, 20), 1)]
    slow, fast = join(blobs, time_scale=300.0), join(blobs, time_scale=1000.0)
    assert slow[0] == slow[1]
    assert fast[0] != fast[1]


def test_stream_waits_for_heads_that_may_still_come():
    joiner = ClusterJoiner(0, 1000.0, JoinOptions(radius=10.0))
    out = joiner.add(settled([(blob(50, 50, 0), 0)], until=5 * MS))
    assert out.ended == []
    assert out.track_id.tolist() == [0] * 6
    assert 0 not in out.complete_until  # a successor may reach back
    out = joiner.add(settled([(blob(52, 50, 6), 1)], until=30 * MS))
    assert out.track_id.tolist() == [0] * 6
    assert out.ended == [0]
    assert joiner.idle


def test_head_without_a_full_descriptor_waits_while_its_cluster_is_open():
    joiner = ClusterJoiner(0, 1000.0, JoinOptions())
    out = joiner.add(settled([(blob(50, 50, 0, n=3), 0)], until=10 * MS, open_ids=[0]))
    assert len(out.corners) == 0
    out = joiner.add(settled([(blob(50, 50, 10, n=3), 0)], until=20 * MS, open_ids=[0]))
    assert len(out.corners) == 6
    assert out.complete_until == {0: 20 * MS}


def test_cluster_that_ends_with_less_than_a_descriptor_is_a_track_too():
    first, second = join([(blob(50, 50, 0, n=2), 0), (blob(52, 50, 3, n=1), 1)])
    assert first == second == {0}


def test_nothing_comes_before_a_time_declared_complete():
    joiner = ClusterJoiner(0, 1000.0, JoinOptions(radius=100.0))
    out = joiner.add(settled([(blob(50, 50, 0), 0)], until=10 * MS, open_ids=[0, 1]))
    assert out.complete_until == {0: 10 * MS}
    # Cluster 1 begins before 10 ms: it must not reopen a window of track 0.
    late = np.concatenate([blob(52, 50, 9), blob(52, 50, 20)])
    out = joiner.add(settled([(late, 1)], until=END))
    assert set(out.track_id.tolist()) == {1}
