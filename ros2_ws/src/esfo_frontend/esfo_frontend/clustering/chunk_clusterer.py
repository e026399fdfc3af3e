"""Clusters of corners: HDBSCAN on (x, y, scaled t) in overlapping chunks, stitched through the corners they share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from esfo_core.events import NS_PER_S, EventArray, empty_events
from esfo_frontend.clustering.hdbscan import condensed_tree, package
from esfo_frontend.clustering.hdbscan.kd_tree import build_tree
from esfo_frontend.clustering.hdbscan.spanning_tree import minimum_spanning_tree
from esfo_frontend.labelled_corners import LabelledCorners
from esfo_frontend.options import ClusterOptions, nanoseconds

NOISE = condensed_tree.NOISE


@dataclass(frozen=True)
class SettledClusters:
    """What one chunk settles.

    corners: those whose labels will not change any more. settled: ns; all corners before it have been given out.
    open_ids: clusters that may get more corners. known: ns; every cluster that begins or ends before it is known.
    """

    corners: LabelledCorners
    settled: int
    open_ids: frozenset[int]
    known: int


class ChunkClusterer:
    """Clusters a stream of corners chunk by chunk.

    Chunk k lasts from k * slice - shared to (k + 1) * slice after the stream's first event. A cluster of one chunk
    continues as that of the next chunk with which it shares the most corners (one to one). A corner in two chunks
    gets its label from the chunk whose end is farther away: labels change over in the middle of the shared part.

    HDBSCAN never takes all corners of a chunk as one cluster, so a single moving corner without any noise is not found.
    """

    def __init__(self, time_scale: float, options: ClusterOptions, first_id: int = 0) -> None:
        self._scale = time_scale
        self._options = options
        self._shared = nanoseconds(options.shared)
        self._corners = empty_events()
        self._labels = np.empty(0, np.int64)
        self._settled = np.iinfo(np.int64).min
        self.next_id = first_id

    @property
    def idle(self) -> bool:
        """True when no earlier corner is left that the next chunk would share."""
        return not len(self._corners)

    def add_slice(self, corners: EventArray, end: int) -> SettledClusters:
        """Cluster the corners (N,) of the slice that ends at `end` ns, with those shared with the last chunk."""
        shared, before = len(self._corners), self._labels
        chunk = np.concatenate([self._corners, corners])
        local = cluster(chunk, self._scale, self._options)
        labels = self._global_labels(local, before, shared)
        settled = end - self._shared // 2
        new = (chunk["t"] >= self._settled) & (chunk["t"] < settled)
        keep = chunk["t"] >= end - self._shared
        self._corners, self._labels, self._settled = chunk[keep], labels[keep], settled
        open_ids = frozenset(self._labels[self._labels != NOISE].tolist())
        return SettledClusters(
            LabelledCorners.from_events(chunk[new], labels[new]), settled, open_ids, end - self._shared
        )

    def finish(self) -> SettledClusters:
        """Give out the corners still held, with the labels of the last chunk; nothing stays open."""
        rest = self._corners["t"] >= self._settled
        corners = LabelledCorners.from_events(self._corners[rest], self._labels[rest])
        self._corners, self._labels = empty_events(), np.empty(0, np.int64)
        end = np.iinfo(np.int64).max
        return SettledClusters(corners, end, frozenset(), end)

    def _global_labels(self, local: NDArray[np.int64], before: NDArray[np.int64], shared: int) -> NDArray[np.int64]:
        """Turn labels of one chunk (N,) into labels of the stream; the first `shared` corners had labels `before`."""
        names = dict(stitch(before, local[:shared]))
        table = np.full(int(local.max(initial=NOISE)) + 2, NOISE, np.int64)
        for label in range(len(table) - 1):
            if label not in names:
                names[label] = self.next_id
                self.next_id += 1
            table[label] = names[label]
        return table[local]


def cluster(corners: EventArray, time_scale: float, options: ClusterOptions) -> NDArray[np.int64]:
    """Return the HDBSCAN label (N,) of each corner, -1 for noise; clusters are numbered by their first corner."""
    if len(corners) <= options.min_size:
        return np.full(len(corners), NOISE, np.int64)
    t = (corners["t"] - corners["t"][0]) * (time_scale / NS_PER_S)
    points = np.stack([corners["x"].astype(np.float64), corners["y"].astype(np.float64), t], axis=1)
    return condensed_tree.number_by_first(_ALGORITHMS[options.algorithm](points, options))


def _by_boruvka(points: NDArray[np.float64], options: ClusterOptions) -> NDArray[np.int32]:
    tree = build_tree(points)
    linkage = condensed_tree.single_linkage(*minimum_spanning_tree(tree, options.min_size))
    labels = np.empty(len(points), np.int32)
    labels[tree.order] = condensed_tree.flat_clusters(linkage, options.min_size, options.epsilon)
    return labels


_ALGORITHMS = {"hdbscan": package.labels, "boruvka": _by_boruvka}


def stitch(before: NDArray[np.int64], after: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Match two labellings (N,) of the same corners: one-to-one pairs (after, before), noise left out.

    The pair with the most corners in common is matched first; among equals the one with the lower labels.
    """
    both = (before != NOISE) & (after != NOISE)
    if not both.any():
        return []
    stride = int(after.max(initial=NOISE)) + 1
    keys, count = np.unique(before[both] * stride + after[both], return_counts=True)
    matched: list[tuple[int, int]] = []
    used_before: set[int] = set()
    used_after: set[int] = set()
    for i in np.argsort(-count, kind="stable"):
        old, new = divmod(int(keys[i]), stride)
        if old not in used_before and new not in used_after:
            matched.append((new, old))
            used_before.add(old)
            used_after.add(new)
    return matched
