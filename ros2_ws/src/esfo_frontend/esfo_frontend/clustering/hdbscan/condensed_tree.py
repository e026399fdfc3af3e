"""From a minimum spanning tree to flat clusters: HDBSCAN's condensed tree and its excess-of-mass selection.

The rules are those of the `hdbscan` package (McInnes, Healy, Astels 2017) with its defaults, and with the epsilon of
Malzer and Baum (2019), so that the same tree gives the same clusters.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_frontend.clustering.hdbscan.spanning_tree import find

NOISE = -1
"""Label of points that belong to no cluster."""


class SingleLinkage(NamedTuple):
    """Merges in ascending order of distance: node N + i unites the nodes children[i]; nodes below N are points.

    children: (N - 1, 2) int32. distance: (N - 1,) px. size: (2 N - 1,) int32, points of each node.
    """

    children: NDArray[np.int32]
    distance: NDArray[np.float64]
    size: NDArray[np.int32]


def single_linkage(edges: NDArray[np.int32], distance: NDArray[np.float64]) -> SingleLinkage:
    """Turn a spanning tree, edges (N - 1, 2) with their distances (N - 1,), into merges; ties keep their order."""
    order = np.argsort(distance, kind="stable")
    n = len(edges) + 1
    linkage = SingleLinkage(np.empty((n - 1, 2), np.int32), distance[order], np.ones(2 * n - 1, np.int32))
    _merge(np.ascontiguousarray(edges[order]), linkage.children, linkage.size)
    return linkage


def flat_clusters(linkage: SingleLinkage, min_size: int, epsilon: float) -> NDArray[np.int32]:
    """Return for each point (N,) a number that its cluster alone has, or NOISE.

    A split counts when both sides have `min_size` points; smaller sides are points that fall out of their cluster.
    Of nested clusters that of greater excess of mass is taken, never the one of all points. Clusters that split off
    below `epsilon` px are widened to the first ancestor that did not.
    """
    n = len(linkage.children) + 1
    cluster = np.empty(2 * n - 1, np.int32)
    # Every split beyond the root takes two clusters of min_size points or more apart.
    capacity = 2 * (n // min_size) + 2
    above, birth, mass = np.zeros(capacity, np.int32), np.zeros(capacity), np.zeros(capacity)
    number = _condense(linkage, min_size, cluster, (above, birth, mass))
    name = _select(above[:number], birth[:number], mass[:number], epsilon)
    return np.asarray(name[cluster[:n]])


def number_by_first(labels: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return labels (N,) renumbered 0, 1, ... in the order of their first points; NOISE stays."""
    renumbered = np.empty(len(labels), np.int64)
    _renumber(labels, np.full(int(labels.max(initial=NOISE)) + 1, NOISE, np.int64), renumbered)
    return renumbered


@njit(cache=True, nogil=True)
def _merge(edges, children, size):  # type: ignore[no-untyped-def]
    """Fill `children` and `size` by joining the ends of the edges one after the other."""
    n = len(edges) + 1
    parent = np.arange(n).astype(np.int32)
    node = np.arange(n).astype(np.int32)
    for i in range(n - 1):
        a, b = find(parent, edges[i, 0]), find(parent, edges[i, 1])
        children[i, 0], children[i, 1] = node[a], node[b]
        size[n + i] = size[node[a]] + size[node[b]]
        if size[node[a]] > size[node[b]]:
            a, b = b, a
        parent[a] = b
        node[b] = n + i


@njit(cache=True, nogil=True)
def _condense(linkage, min_size, cluster, condensed):  # type: ignore[no-untyped-def]
    """Assign each node of the linkage to a condensed cluster; return how many there are, the root being cluster 0.

    condensed: above (C,) the cluster that each was split off from, birth (C,) lambda = 1 / distance of that split,
    mass (C,) excess of mass: the sum over its points of the lambda at which they leave it less that of its birth.
    """
    children, distance, size = linkage
    above, birth, mass = condensed
    n = len(children) + 1
    fallen = np.zeros(2 * n - 1, np.bool_)
    cluster[2 * n - 2] = 0
    number = 1
    for i in range(n - 2, -1, -1):
        c, a, b = cluster[n + i], children[i, 0], children[i, 1]
        cluster[a] = cluster[b] = c
        if fallen[n + i]:
            fallen[a] = fallen[b] = True
            continue
        density = 1.0 / distance[i] if distance[i] > 0.0 else np.inf
        split = size[a] >= min_size and size[b] >= min_size
        for child in (a, b):
            if split:
                cluster[child] = number
                above[number], birth[number] = c, density
                number += 1
            elif size[child] < min_size:
                fallen[child] = True
            else:
                continue
            mass[c] += (density - birth[c]) * size[child]
    return number


@njit(cache=True, nogil=True)
def _select(above, birth, mass, epsilon):  # type: ignore[no-untyped-def]
    """Return for each condensed cluster (C,) the nearest selected one at or above it, or NOISE."""
    number = len(above)
    selected, covered = np.zeros(number, np.bool_), np.zeros(number, np.bool_)
    below = np.zeros(number)
    # A cluster has a higher number than that it was split off from.
    for c in range(number - 1, 0, -1):
        selected[c] = not below[c] > mass[c]
        below[above[c]] += mass[c] if selected[c] else below[c]
    for c in range(1, number):
        selected[c] &= not covered[above[c]]
        covered[c] = selected[c] or covered[above[c]]
    if epsilon > 0.0:
        selected = _widen(above, birth, selected, epsilon)
    name = np.full(number, NOISE, np.int32)
    for c in range(1, number):
        name[c] = c if selected[c] else name[above[c]]
    return name


@njit(cache=True, nogil=True)
def _widen(above, birth, selected, epsilon):  # type: ignore[no-untyped-def]
    """Return the selection (C,) with every cluster that split off below epsilon replaced by an ancestor."""
    wider = np.zeros(len(above), np.bool_)
    for c in range(1, len(above)):
        if selected[c]:
            wide = c
            if 1.0 / birth[c] < epsilon:
                while above[wide] != 0:
                    wide = above[wide]
                    if 1.0 / birth[wide] > epsilon:
                        break
            wider[wide] = True
    return wider


@njit(cache=True, nogil=True)
def _renumber(labels, number, renumbered):  # type: ignore[no-untyped-def]
    """Fill `renumbered` (N,); number (C,) gets the new label of each old one and comes filled with NOISE."""
    count = 0
    for q in range(len(labels)):
        c = labels[q]
        if c != NOISE and number[c] == NOISE:
            number[c] = count
            count += 1
        renumbered[q] = number[c] if c != NOISE else NOISE
