"""A balanced k-d tree over points (x, y, scaled t), with the nearest neighbours of all points at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

LEAF_SIZE = 16
"""Points in a leaf, at most. Between 8 and 24 the time of all that walks the tree changes by less than a tenth."""

STACK = 64
"""Nodes that can wait while a tree is walked depth first: more than the depth of any tree that fits in memory."""


class KdTree(NamedTuple):
    """A complete binary tree: node 1 is the root, the children of node i are 2 i and 2 i + 1, the last L are leaves.

    points: (N, 3) float64 px, such that the points of every node lie side by side; leaf i of L has the rows
    i N // L to (i + 1) N // L. order: (N,) int32, the row that each had in the input.
    box: (2 L, 6) float64, least and greatest x, y, t of the points of each node; row 0 is not used.
    """

    points: NDArray[np.float64]
    order: NDArray[np.int32]
    box: NDArray[np.float64]


def build_tree(points: NDArray[np.float64]) -> KdTree:
    """Split points (N, 3), N > 0, at the median of their longest side until at most LEAF_SIZE are left."""
    leaves = 1
    while len(points) > LEAF_SIZE * leaves:
        leaves *= 2
    tree = KdTree(
        np.array(points, np.float64, order="C"), np.arange(len(points), dtype=np.int32), np.empty((2 * leaves, 6))
    )
    _split(tree.points, tree.order, tree.box)
    return tree


def nearest_neighbours(tree: KdTree, k: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return squared distances (N, k), ascending, and rows (N, k) of the k < N points that are nearest to each point.

    Rows are those of `tree.points`; a point is no neighbour of itself.
    """
    n = len(tree.points)
    distance2, near = np.full((n, k), np.inf), np.empty((n, k), np.int32)
    _nearest(tree, distance2, near)
    return distance2, near


@njit(cache=True, nogil=True)
def first_row(leaf, leaves, n):  # type: ignore[no-untyped-def]
    """Return the first of the n rows that belongs to leaf number `leaf` of `leaves`."""
    return leaf * n // leaves


@njit(cache=True, nogil=True)
def box_gap2(box, a, b):  # type: ignore[no-untyped-def]
    """Return the squared distance between the boxes of the nodes a and b."""
    total = 0.0
    for d in range(3):
        gap = max(box[a, d] - box[b, 3 + d], box[b, d] - box[a, 3 + d])
        if gap > 0:
            total += gap * gap
    return total


@njit(cache=True, nogil=True)
def point_gap2(box, node, point):  # type: ignore[no-untyped-def]
    """Return the squared distance between a point (x, y, t) and the box of a node."""
    total = 0.0
    for d in range(3):
        gap = max(box[node, d] - point[d], point[d] - box[node, 3 + d])
        if gap > 0:
            total += gap * gap
    return total


@njit(cache=True, nogil=True)
def push_children(box, own, node, stack, size):  # type: ignore[no-untyped-def]
    """Put both children of a node on the stack, that nearer to the box of `own` on top; return the new size."""
    far = 2 * node
    if box_gap2(box, own, far) < box_gap2(box, own, far + 1):
        far += 1
    stack[size], stack[size + 1] = far, far ^ 1
    return size + 2


@njit(cache=True, nogil=True)
def _split(points, order, box):  # type: ignore[no-untyped-def]
    """Fill `box` level by level and bring `points`, with `order`, into the order of the leaves."""
    n, leaves, width = len(points), len(box) // 2, 1
    while width <= leaves:
        for i in range(width):
            start, stop = first_row(i, width, n), first_row(i + 1, width, n)
            extent = box[width + i]
            axis = 0
            for d in range(3):
                extent[d] = extent[3 + d] = points[start, d]
                for q in range(start + 1, stop):
                    extent[d] = min(extent[d], points[q, d])
                    extent[3 + d] = max(extent[3 + d], points[q, d])
                if extent[3 + d] - extent[d] > extent[3 + axis] - extent[axis]:
                    axis = d
            if width < leaves:
                _select(points, order, (start, stop), first_row(2 * i + 1, 2 * width, n), axis)
        width *= 2


@njit(cache=True, nogil=True)
def _select(points, order, rows, middle, axis):  # type: ignore[no-untyped-def]
    """Move rows so that none before `middle` is greater along `axis`, and none after it less, than that at `middle`.

    Hoare's selection, in place, on the rows from rows[0] up to rows[1].
    """
    left, right = rows[0], rows[1] - 1
    while left < right:
        a, b, c = points[left, axis], points[(left + right) // 2, axis], points[right, axis]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = left, right
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while points[j, axis] > pivot:
                j -= 1
            if i <= j:
                for d in range(3):
                    points[i, d], points[j, d] = points[j, d], points[i, d]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            right = j
        elif middle >= i:
            left = i
        else:
            return


@njit(cache=True, nogil=True)
def _nearest(tree, distance2, near):  # type: ignore[no-untyped-def]
    """Fill the lists of all points, those of a leaf together: from their leaf upwards through its sibling nodes."""
    points, box = tree.points, tree.box
    n, leaves = len(points), len(box) // 2
    stack = np.empty(STACK, np.int64)
    for leaf in range(leaves):
        rows = (first_row(leaf, leaves, n), first_row(leaf + 1, leaves, n))
        own = up = leaves + leaf
        bound = _scan(points, box, own, rows, distance2, near)
        while up > 1:
            stack[0], size = up ^ 1, 1
            while size > 0:
                size -= 1
                node = stack[size]
                if box_gap2(box, own, node) >= bound:
                    continue
                if node >= leaves:
                    bound = _scan(points, box, node, rows, distance2, near)
                else:
                    size = push_children(box, own, node, stack, size)
            up //= 2


@njit(cache=True, nogil=True)
def _scan(points, box, node, rows, distance2, near):  # type: ignore[no-untyped-def]
    """Enter the points of a leaf `node` in the lists of the points rows[0] to rows[1].

    Returns the greatest squared distance at which a point could still enter one of these lists.
    """
    n, leaves, last = len(points), len(box) // 2, distance2.shape[1] - 1
    start, stop = first_row(node - leaves, leaves, n), first_row(node - leaves + 1, leaves, n)
    bound = 0.0
    for q in range(rows[0], rows[1]):
        x, y, t = points[q, 0], points[q, 1], points[q, 2]
        kth = distance2[q, last]
        if point_gap2(box, node, (x, y, t)) < kth:
            for r in range(start, stop):
                dx, dy, dt = points[r, 0] - x, points[r, 1] - y, points[r, 2] - t
                d2 = dx * dx + dy * dy + dt * dt
                if d2 < kth and r != q:
                    i = last
                    while i > 0 and distance2[q, i - 1] > d2:
                        distance2[q, i], near[q, i] = distance2[q, i - 1], near[q, i - 1]
                        i -= 1
                    distance2[q, i], near[q, i] = d2, r
                    kth = distance2[q, last]
        bound = max(bound, kth)
    return bound
