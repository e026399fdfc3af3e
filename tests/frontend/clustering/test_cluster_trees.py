"""The k-d tree, the minimum spanning tree and the flat clusters, each against a slow twin or the `hdbscan` package."""

import itertools

import numpy as np
import pytest
from hdbscan import HDBSCAN
from hdbscan._hdbscan_linkage import label
from hdbscan.hdbscan_ import _tree_to_labels
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import minimum_spanning_tree as scipy_spanning_tree

from esfo_core.events import make_events
from esfo_frontend.clustering.chunk_clusterer import NOISE, cluster
from esfo_frontend.clustering.hdbscan.condensed_tree import flat_clusters, number_by_first, single_linkage
from esfo_frontend.clustering.hdbscan.kd_tree import LEAF_SIZE, build_tree, nearest_neighbours
from esfo_frontend.clustering.hdbscan.spanning_tree import minimum_spanning_tree
from esfo_frontend.options import ClusterOptions

SIZES = (2, 3, LEAF_SIZE, LEAF_SIZE + 1, 100, 400)


def blobs(seed, n, on_pixels=False):
    """Points (n, 3) in a few tubes along time, as moving corners leave them, among single ones."""
    rng = np.random.default_rng(seed)
    tubes = rng.integers(1, 8)
    tube = rng.integers(0, tubes + 1, n)
    t = rng.uniform(0, 40, n)
    path = rng.uniform(0, 60, (tubes + 1, 2))[tube] + t[:, None] * rng.uniform(-0.3, 0.3, (tubes + 1, 2))[tube]
    xy = np.where(tube[:, None] == 0, rng.uniform(0, 60, (n, 2)), path + rng.normal(0, rng.uniform(0.3, 2), (n, 2)))
    return np.column_stack([np.rint(xy), np.rint(t)] if on_pixels else [xy, t])


def reachability(points, k):
    """The matrix (N, N) of mutual reachabilities, from its definition."""
    distance = np.sqrt(((points[:, None] - points[None]) ** 2).sum(axis=2))
    core = np.sort(distance, axis=1)[:, k]
    return np.maximum(distance, np.maximum(core[:, None], core[None]))


def spanning_weights(matrix):
    """Ascending weights (N - 1,) of the minimum spanning trees of a full matrix: Prim's algorithm."""
    inside = np.zeros(len(matrix), bool)
    inside[0] = True
    best, weights = matrix[0].copy(), []
    for _ in range(len(matrix) - 1):
        nearest = int(np.argmin(np.where(inside, np.inf, best)))
        weights.append(best[nearest])
        inside[nearest] = True
        best = np.minimum(best, matrix[nearest])
    return np.sort(weights)


def components(n, edges):
    """Label (N,) of the connected component of each point."""
    name = np.arange(n)
    for a, b in edges:
        name[name == name[a]] = name[b]
    return name


def same_partition(a, b):
    """True when two labellings (N,) differ only in the names of their clusters; noise must be noise in both."""
    pairs = set(zip(a.tolist(), b.tolist(), strict=True))
    one_to_one = len(pairs) == len({p for p, _ in pairs}) == len({q for _, q in pairs})
    return one_to_one and np.array_equal(a == NOISE, b == NOISE)


inputs = {"seed": st.integers(0, 10**6), "n": st.sampled_from(SIZES), "on_pixels": st.booleans()}


@settings(deadline=None, max_examples=60)
@given(**inputs)
def test_tree_holds_each_point_once_inside_of_its_boxes(seed, n, on_pixels):
    points = blobs(seed, n, on_pixels)
    tree = build_tree(points)
    assert np.array_equal(np.sort(tree.order), np.arange(n))
    assert np.array_equal(tree.points, points[tree.order])
    leaves = len(tree.box) // 2
    width = 1
    while width <= leaves:
        for i in range(width):
            part = tree.points[i * n // width : (i + 1) * n // width]
            assert np.array_equal(tree.box[width + i], np.concatenate([part.min(axis=0), part.max(axis=0)]))
        width *= 2
    assert n / leaves <= LEAF_SIZE


@settings(deadline=None, max_examples=60)
@given(**inputs, k=st.integers(1, 12))
def test_neighbours_are_the_nearest(seed, n, on_pixels, k):
    k = min(k, n - 1)
    tree = build_tree(blobs(seed, n, on_pixels))
    distance2, near = nearest_neighbours(tree, k)
    true2 = ((tree.points[:, None] - tree.points[None]) ** 2).sum(axis=2)
    np.testing.assert_allclose(distance2, np.sort(true2 + np.diag(np.full(n, np.inf)), axis=1)[:, :k], rtol=1e-12)
    np.testing.assert_allclose(np.take_along_axis(true2, near.astype(np.int64), axis=1), distance2, rtol=1e-12)
    assert (near != np.arange(n)[:, None]).all()
    assert all(len(set(row)) == k for row in near.tolist())


@settings(deadline=None, max_examples=100)
@given(**inputs, k=st.integers(1, 12))
def test_spanning_tree_is_a_minimum_one(seed, n, on_pixels, k):
    k = min(k, n - 1)
    tree = build_tree(blobs(seed, n, on_pixels))
    edges, distance = minimum_spanning_tree(tree, k)
    matrix = reachability(tree.points, k)
    np.testing.assert_allclose(distance, matrix[edges[:, 0], edges[:, 1]], rtol=1e-12)
    assert len(np.unique(components(n, edges))) == 1
    # All minimum spanning trees of a graph have the same weights, ties or not.
    np.testing.assert_allclose(np.sort(distance), spanning_weights(matrix), rtol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_spanning_tree_of_many_points_is_as_short_as_that_of_hdbscan(seed):
    points = blobs(seed, 4000) * [3.0, 3.0, 1.0]
    _, distance = minimum_spanning_tree(build_tree(points), 10)
    model = HDBSCAN(min_cluster_size=10, approx_min_span_tree=False, core_dist_n_jobs=1, gen_min_span_tree=True)
    model.fit(points)
    expected = model.minimum_spanning_tree_.to_numpy()[:, 2]
    np.testing.assert_allclose(np.sort(distance), np.sort(expected), rtol=1e-12)


def test_twin_of_the_spanning_tree_agrees_with_scipy():
    matrix = reachability(blobs(1, 100), 10)
    np.testing.assert_allclose(spanning_weights(matrix), np.sort(scipy_spanning_tree(matrix).data), rtol=1e-12)


@pytest.mark.parametrize(
    "points", [np.zeros((60, 3)), np.tile(np.arange(60.0)[:, None], (1, 3)), np.eye(3)[[0] * 50 + [1] * 50]]
)
def test_spanning_tree_of_points_on_top_of_each_other_or_in_line(points):
    edges, distance = minimum_spanning_tree(build_tree(points), 10)
    assert len(np.unique(components(len(points), edges))) == 1
    np.testing.assert_allclose(np.sort(distance), spanning_weights(reachability(points, 10)), rtol=1e-12)


@settings(deadline=None, max_examples=150)
@example(seed=1, n=100, on_pixels=True, min_size=2, epsilon=5.0)  # a split at epsilon exactly
@given(**inputs, min_size=st.integers(2, 12), epsilon=st.sampled_from([0.0, 0.5, 2.0, 5.0, 100.0]))
def test_flat_clusters_of_a_tree_are_those_of_hdbscan(seed, n, on_pixels, min_size, epsilon):
    """From the same sorted edges the package must come to the same clusters, ties or not."""
    tree = build_tree(blobs(seed, n, on_pixels))
    edges, distance = minimum_spanning_tree(tree, min(min_size, n - 1))
    order = np.argsort(distance, kind="stable")
    linkage = label(np.column_stack([edges, distance]).astype(np.float64)[order])
    with np.errstate(invalid="ignore", divide="ignore"):
        expected = _tree_to_labels(None, linkage, min_size, cluster_selection_epsilon=epsilon)[0]
    assert same_partition(flat_clusters(single_linkage(edges, distance), min_size, epsilon), expected)


def hdbscan_labels(corners, options, seed):
    """Labels (N,) by the package of the corners, given to it in another order: it breaks ties by that order."""
    order = np.random.default_rng(seed).permutation(len(corners))
    t = (corners["t"] - corners["t"][0]) * 300e-9
    points = np.column_stack([corners["x"], corners["y"], t]).astype(np.float64)[order]
    labels = np.empty(len(corners), np.int64)
    model = HDBSCAN(
        min_cluster_size=options.min_size,
        cluster_selection_epsilon=options.epsilon,
        approx_min_span_tree=False,
        core_dist_n_jobs=1,
    )
    labels[order] = model.fit_predict(points)
    return labels


@settings(deadline=None)
@given(st.lists(st.integers(-1, 5), max_size=30))
def test_numbers_follow_the_first_points(labels):
    order = list(dict.fromkeys(v for v in labels if v != NOISE))
    found = number_by_first(np.array(labels, np.int32))
    assert found.tolist() == [NOISE if v == NOISE else order.index(v) for v in labels]


def corners_of(points):
    """Corner events in order of time at points (N, 3)."""
    points = points[np.argsort(points[:, 2])]
    xy = np.rint(points[:, :2]) + 20
    return make_events(xy[:, 0], xy[:, 1], np.ones(len(points)), points[:, 2] / 300e-9)


@pytest.mark.parametrize("epsilon", [0.0, 3.0])
def test_clusters_differ_from_those_of_hdbscan_no_more_than_these_from_themselves(epsilon):
    """Where two clusters meet, a point has edges to both that are as long as its core distance. Which comes first is
    open: the package decides by the order of its input, so that it does not agree with itself either."""
    options = ClusterOptions(epsilon=epsilon)
    own, other = [], []
    for seed in range(40):
        corners = corners_of(blobs(seed, 400))
        answers = [hdbscan_labels(corners, options, i) for i in range(4)]
        found = cluster(corners, 300.0, options)
        other += [1 - rand_index(found, a) for a in answers]
        own += [1 - rand_index(a, b) for a, b in itertools.combinations(answers, 2)]
    assert 0 < np.mean(other) <= 2 * np.mean(own)


def rand_index(a, b):
    """Share of pairs of points on which two labellings (N,) agree; each noise point is a cluster of its own."""
    a, b = (np.where(v == NOISE, len(v) + np.arange(len(v)), v) for v in (a, b))
    upper = np.triu_indices(len(a), 1)
    return ((a[:, None] == a)[upper] == (b[:, None] == b)[upper]).mean()


def test_order_of_corners_with_equal_times_does_not_matter():
    corners = corners_of(blobs(3, 400, on_pixels=True))
    order = np.lexsort((np.random.default_rng(0).random(400), corners["t"]))
    a, b = (cluster(c, 300.0, ClusterOptions()) for c in (corners, corners[order]))
    assert rand_index(a[order], b) > 0.99
