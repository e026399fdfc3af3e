"""Chunked clustering and its stitching."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_core.events import make_events
from esfo_frontend.clustering.chunk_clusterer import NOISE, ChunkClusterer, cluster, stitch
from esfo_frontend.options import ClusterOptions

MS = 1_000_000


def lines(duration_ms, per_ms=1, noise=0, seed=0):
    """Three corners that drift slowly, apart from each other; returns corners and which line each belongs to (-1)."""
    rng = np.random.default_rng(seed)
    t = np.repeat(np.arange(duration_ms * per_ms) * MS // per_ms, 3)
    line = np.tile(np.arange(3), duration_ms * per_ms)
    x = 30 + 60 * line + np.rint(t / 1e9 * 50 + rng.normal(0, 0.7, len(t)))
    y = 40 + np.rint(rng.normal(0, 0.7, len(t)))
    t = np.concatenate([t, rng.integers(0, duration_ms * MS, noise)])
    x = np.concatenate([x, rng.integers(0, 300, noise)])
    y = np.concatenate([y, rng.integers(60, 300, noise)])
    line = np.concatenate([line, np.full(noise, -1)])
    order = np.argsort(t, kind="stable")
    return make_events(x[order], y[order], np.ones(len(t)), t[order]), line[order]


def run(corners, slice_ms, options, finish=True):
    clusterer = ChunkClusterer(300.0, options)
    steps, start = [], 0
    for end in range(slice_ms, int(corners["t"][-1]) // MS + slice_ms + 1, slice_ms):
        n = int(np.searchsorted(corners["t"], end * MS))
        steps.append(clusterer.add_slice(corners[start:n], end * MS))
        start = n
    return steps + ([clusterer.finish()] if finish else [])


def test_clusters_go_on_through_many_chunks():
    corners, line = lines(400)
    steps = run(corners, 30, ClusterOptions(chunk=40, shared=10))
    labels = np.concatenate([s.corners.label for s in steps])
    assert np.array_equal(np.concatenate([s.corners.t for s in steps]), corners["t"])  # each corner once, in order
    for k in range(3):
        of_line = labels[line == k]
        assert (of_line == NOISE).mean() < 0.05
        # HDBSCAN may split a line, yet most of it must be one cluster over the ten chunks.
        assert np.bincount(of_line[of_line != NOISE]).max() > 0.8 * len(of_line)
    pairs = set(zip(line.tolist(), labels.tolist(), strict=True))
    clusters = [c for _, c in pairs if c != NOISE]
    assert len(clusters) == len(set(clusters))  # no cluster holds corners of two lines


def test_settled_corners_and_open_clusters_keep_their_promises():
    corners, _ = lines(200, noise=200)
    steps = run(corners, 30, ClusterOptions(chunk=40, shared=10))
    for before, after in itertools.pairwise(steps):
        assert (before.corners.t < before.settled).all()
        assert (after.corners.t >= before.settled).all()
    for i, step in enumerate(steps):
        later = set(np.concatenate([s.corners.label for s in steps[i + 1 :]] or [[]]).tolist())
        earlier = set(np.concatenate([s.corners.label for s in steps[: i + 1]]).tolist())
        assert (later & earlier) - {NOISE} <= step.open_ids


def test_labels_change_over_in_the_middle_of_the_shared_part():
    corners, _ = lines(120)
    options = ClusterOptions(chunk=60, shared=20)
    steps = run(corners, 40, options)
    assert [s.settled // MS for s in steps[:2]] == [30, 70]
    # Up to 30 ms the labels are those of the first chunk alone, from there to 70 ms those of 20 to 80 ms.
    for step, (start, end) in zip(steps, [(0, 40), (20, 80)], strict=False):
        chunk = corners[(corners["t"] >= start * MS) & (corners["t"] < end * MS)]
        alone = cluster(chunk, 300.0, options)[np.isin(chunk["t"], step.corners.t)]
        pairs = set(zip(alone.tolist(), step.corners.label.tolist(), strict=True))
        assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs}) > 2


@pytest.mark.parametrize("algorithm", ["boruvka", "hdbscan"])
def test_too_few_corners_are_noise(algorithm):
    options = ClusterOptions(min_size=10, algorithm=algorithm)
    for n in (0, 1, 2, 10, 11, 19):
        corners = make_events(np.zeros(n), np.zeros(n), np.zeros(n), np.arange(n))
        assert cluster(corners, 300.0, options).tolist() == [NOISE] * n


@pytest.mark.parametrize("algorithm", ["boruvka", "hdbscan"])
def test_labels_are_numbered_by_first_corner(algorithm):
    labels = cluster(lines(40)[0], 300.0, ClusterOptions(algorithm=algorithm))
    found, first = np.unique(labels[labels != NOISE], return_index=True)
    assert len(found) >= 3
    assert (np.diff(first) > 0).all()


def test_stitching_takes_the_larger_part_and_never_one_cluster_twice():
    before = np.array([5, 5, 5, 5, 5, 7, 7, -1, -1])
    after = np.array([0, 0, 1, 1, 1, 1, 2, 2, -1])
    assert dict(stitch(before, after)) == {1: 5, 2: 7}
    assert stitch(before[:0], after[:0]) == []
    assert stitch(np.array([-1, 3]), np.array([2, -1])) == []


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(-1, 4), st.integers(-1, 4)), max_size=40))
def test_stitching_is_one_to_one_greedy_by_count(rows):
    table = np.array(rows, np.int64).reshape(-1, 2)
    left = {(b, a): n for b in range(5) for a in range(5) if (n := rows.count((b, a)))}
    expected = {}
    while left:
        best = min(left, key=lambda p: (-left[p], p))
        expected[best[1]] = best[0]
        left = {p: n for p, n in left.items() if p[0] != best[0] and p[1] != best[1]}
    assert dict(stitch(table[:, 0], table[:, 1])) == expected
