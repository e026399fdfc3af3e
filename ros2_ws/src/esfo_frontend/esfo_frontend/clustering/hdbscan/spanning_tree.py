"""Minimum spanning tree of the mutual reachability distance, exact, with Boruvka's algorithm on a k-d tree.

The mutual reachability of two points is the greatest of their distance and their two core distances; the core distance
of a point is the distance to its k-th neighbour (Campello, Moulavi, Sander 2013). Three things make it fast here:

- An edge that is as short as the core distance of one of its ends is the best that this point can have. The list of k
  neighbours from which the core distances come holds such an edge for nine points in ten.
- Only the small components look for their best edge: the large ones, which hold most of the points, are found by them.
- What a point has learnt is kept: the others only move into its component, so its nearest foreign point is never
  nearer than it was.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_frontend.clustering.hdbscan.kd_tree import (
    STACK,
    KdTree,
    box_gap2,
    first_row,
    nearest_neighbours,
    point_gap2,
    push_children,
)


class _Forest(NamedTuple):
    """The components between two rounds; all reachabilities are squared, px^2.

    Of each point (N,): parent: of the union-find. component: its root. reach: no foreign point is nearer than this.
    nearest: the foreign point that is exactly so near, -1 when it is not known. Of each root: size: of the component.
    bound: its shortest edge found. source, target: the ends of that edge, inside and outside.
    Of each tree node (2 L,): densest: least core distance. only: the component that all its points belong to, or -1.
    """

    parent: NDArray[np.int32]
    component: NDArray[np.int32]
    reach: NDArray[np.float64]
    nearest: NDArray[np.int32]
    size: NDArray[np.int32]
    bound: NDArray[np.float64]
    source: NDArray[np.int32]
    target: NDArray[np.int32]
    densest: NDArray[np.float64]
    only: NDArray[np.int32]


def minimum_spanning_tree(tree: KdTree, k: int) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Return the edges (N - 1, 2), as rows of `tree.points`, and their mutual reachabilities (N - 1,), px.

    k < N: the neighbour that gives the core distance, a point itself not counted. Edges come in the order in which
    they were found. Where edges tie, which is common because all edges of a sparse point are as long as its core
    distance, a point is first linked to the nearest of its neighbours that are at least as dense.
    """
    n, nodes = len(tree.points), len(tree.box)
    distance2, near = nearest_neighbours(tree, k)
    core2 = np.ascontiguousarray(distance2[:, -1])
    i32 = np.int32
    forest = _Forest(
        parent=np.arange(n, dtype=i32),
        component=np.empty(n, i32),
        reach=core2.copy(),
        nearest=np.full(n, -1, i32),
        size=np.empty(n, i32),
        bound=np.empty(n),
        source=np.empty(n, i32),
        target=np.empty(n, i32),
        densest=np.empty(nodes),
        only=np.empty(nodes, i32),
    )
    edges, reach2 = np.empty((n - 1, 2), i32), np.empty(n - 1)
    _boruvka(tree, core2, near, forest, (edges, reach2))
    return edges, np.sqrt(reach2)


@njit(cache=True, nogil=True)
def find(parent, i):  # type: ignore[no-untyped-def]
    """Return the root of i in a union-find, halving the path to it."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True, nogil=True)
def _boruvka(tree, core2, near, forest, result):  # type: ignore[no-untyped-def]
    """Fill the edges and squared reachabilities of `result`, joining components until one is left."""
    n, leaves = len(core2), len(tree.box) // 2
    densest = forest.densest
    for leaf in range(leaves):
        densest[leaves + leaf] = core2[first_row(leaf, leaves, n) : first_row(leaf + 1, leaves, n)].min()
    for node in range(leaves - 1, 0, -1):
        densest[node] = min(densest[2 * node], densest[2 * node + 1])
    count = _link_to_denser(core2, near, forest.parent, result)
    limit = 0
    while count < n - 1:
        limit = max(2 * limit, _begin_round(forest))
        _try_neighbours(core2, near, forest, limit)
        _search(tree, core2, forest, limit)
        count = _join(forest, limit, count, result)


@njit(cache=True, nogil=True)
def _link_to_denser(core2, near, parent, result):  # type: ignore[no-untyped-def]
    """Link each point to the nearest of its neighbours that is at least as dense: no edge of it can be shorter."""
    edges, reach2 = result
    count = 0
    for q in range(len(core2)):
        for j in range(near.shape[1]):
            r = near[q, j]
            if core2[r] <= core2[q]:
                a, b = find(parent, q), find(parent, r)
                if a != b:
                    parent[a] = b
                    edges[count, 0], edges[count, 1], reach2[count] = q, r, core2[q]
                    count += 1
                break
    return count


@njit(cache=True, nogil=True)
def _begin_round(forest):  # type: ignore[no-untyped-def]
    """Write down which component each point and each node belongs to; return the size of the smallest one."""
    n, leaves, only = len(forest.parent), len(forest.only) // 2, forest.only
    forest.size[:] = 0
    forest.bound[:] = np.inf
    for q in range(n):
        c = find(forest.parent, q)
        forest.component[q] = c
        forest.size[c] += 1
    for leaf in range(leaves):
        start, stop = first_row(leaf, leaves, n), first_row(leaf + 1, leaves, n)
        c = forest.component[start]
        for q in range(start + 1, stop):
            if forest.component[q] != c:
                c = -1
                break
        only[leaves + leaf] = c
    for node in range(leaves - 1, 0, -1):
        only[node] = only[2 * node] if only[2 * node] == only[2 * node + 1] else -1
    smallest = n
    for q in range(n):
        if forest.size[q] > 0:
            smallest = min(smallest, forest.size[q])
    return smallest


@njit(cache=True, nogil=True)
def _offer(forest, q, r, reach2):  # type: ignore[no-untyped-def]
    """Take the edge from q to r for the components of both where it is their shortest so far."""
    c = forest.component[q]
    if reach2 < forest.bound[c]:
        forest.bound[c], forest.source[c], forest.target[c] = reach2, q, r
    c = forest.component[r]
    if reach2 < forest.bound[c]:
        forest.bound[c], forest.source[c], forest.target[c] = reach2, r, q


@njit(cache=True, nogil=True)
def _try_neighbours(core2, near, forest, limit):  # type: ignore[no-untyped-def]
    """Bound the components of at most `limit` points by the foreign points already known and by the neighbour lists."""
    component, nearest, reach = forest.component, forest.nearest, forest.reach
    for q in range(len(core2)):
        c = component[q]
        if forest.size[c] > limit:
            continue
        if nearest[q] >= 0:
            if component[nearest[q]] != c:
                _offer(forest, q, nearest[q], reach[q])
                continue
            nearest[q] = -1
        if reach[q] >= forest.bound[c]:
            continue
        best, found = np.inf, -1
        for j in range(near.shape[1]):
            r = near[q, j]
            # Neighbours in the list are within the core distance, so only the core distances count.
            if component[r] != c and max(core2[r], core2[q]) < best:
                best, found = max(core2[r], core2[q]), r
        if found >= 0:
            _offer(forest, q, found, best)
            if best == core2[q]:
                nearest[q], reach[q] = found, best


@njit(cache=True, nogil=True)
def _search(tree, core2, forest, limit):  # type: ignore[no-untyped-def]
    """Find the shortest edge of every component of at most `limit` points.

    Searched for are the nearest foreign points of all points that could have one nearer than their component's bound,
    those of a leaf together.
    """
    n, leaves = len(core2), len(tree.box) // 2
    capacity = n // leaves + 1
    rows, best, found = np.empty(capacity, np.int64), np.empty(capacity), np.empty(capacity, np.int64)
    stack = np.empty(STACK, np.int64)
    for leaf in range(leaves):
        number = 0
        for q in range(first_row(leaf, leaves, n), first_row(leaf + 1, leaves, n)):
            c = forest.component[q]
            if forest.size[c] <= limit and forest.nearest[q] < 0 and forest.reach[q] < forest.bound[c]:
                rows[number], best[number], found[number] = q, forest.bound[c], -1
                number += 1
        if number == 0:
            continue
        _nearest_foreign(tree, core2, forest, (rows[:number], best, found), stack)
        for i in range(number):
            q = rows[i]
            forest.reach[q] = max(best[i], core2[q])
            if found[i] >= 0:
                forest.nearest[q] = found[i]
                _offer(forest, q, found[i], forest.reach[q])


@njit(cache=True, nogil=True, inline="always")
def _nearest_foreign(tree, core2, forest, search, stack):  # type: ignore[no-untyped-def]
    """Walk the tree from the leaf of the searching points (rows) up, for the nearest foreign point (found) of each.

    search: rows (M,), all of one leaf; best: reachability below which to search, replaced by what was found; found.
    """
    box, n, leaves = tree.box, len(core2), len(tree.box) // 2
    rows, best, _ = search
    own = up = leaves + ((rows[0] + 1) * leaves - 1) // n
    bound = 0.0
    for i in range(len(rows)):
        bound = max(bound, best[i])
    stack[0], size = own, 1
    while True:
        while size > 0:
            size -= 1
            node = stack[size]
            c = forest.only[node]
            if c >= 0 and c == forest.only[own]:
                continue
            if forest.densest[node] >= bound or box_gap2(box, own, node) >= bound:
                continue
            if node >= leaves:
                bound = _scan(tree, core2, forest, search, node)
            else:
                size = push_children(box, own, node, stack, size)
        if up == 1:
            return
        stack[0], size = up ^ 1, 1
        up //= 2


@njit(cache=True, nogil=True, inline="always")
def _scan(tree, core2, forest, search, node):  # type: ignore[no-untyped-def]
    """Compare the points of a leaf `node` with all searching points; return the greatest bound left."""
    points, component = tree.points, forest.component
    n, leaves = len(points), len(tree.box) // 2
    rows, best, found = search
    start, stop = first_row(node - leaves, leaves, n), first_row(node - leaves + 1, leaves, n)
    bound = 0.0
    for i in range(len(rows)):
        q, reach2 = rows[i], best[i]
        c = component[q]
        x, y, t = points[q, 0], points[q, 1], points[q, 2]
        # Nothing is nearer than the core distance: such a point has found what it can.
        if reach2 > core2[q] and forest.only[node] != c and point_gap2(tree.box, node, (x, y, t)) < reach2:
            for r in range(start, stop):
                if core2[r] >= reach2 or component[r] == c:
                    continue
                dx, dy, dt = points[r, 0] - x, points[r, 1] - y, points[r, 2] - t
                d2 = max(dx * dx + dy * dy + dt * dt, core2[r])
                if d2 < reach2:
                    reach2, found[i] = d2, r
            best[i] = reach2
        if reach2 > core2[q]:
            bound = max(bound, reach2)
    return bound


@njit(cache=True, nogil=True)
def _join(forest, limit, count, result):  # type: ignore[no-untyped-def]
    """Add the shortest edge of every component of at most `limit` points; return the number of edges there are now."""
    edges, reach2 = result
    for c in range(len(forest.size)):
        if forest.size[c] == 0 or forest.size[c] > limit:
            continue
        a, b = find(forest.parent, forest.source[c]), find(forest.parent, forest.target[c])
        if a != b:
            forest.parent[a] = b
            edges[count, 0], edges[count, 1] = forest.source[c], forest.target[c]
            reach2[count] = forest.bound[c]
            count += 1
    return count
