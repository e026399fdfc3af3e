"""From a mesh to the triangles that are drawn: cut where the lens cannot see, and too short for it to bend them.

Everything happens on the plane z = 1, where edges are straight and 1/z is linear, before the lens bends them. An edge
of length L whose image bends by at most B px per unit squared leaves its chord by at most B L^2 / 8; edges are halved
until that is below the tolerance. Whether an edge is halved, and where, depends on its two ends alone, so that the
neighbour on its other side does the same and no crack opens.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import trimesh
from numba import njit
from numpy.typing import NDArray

from esfo_core.camera import Camera
from esfo_simulation.render.surface import Model, Points

CHORD_ERROR_PX = 0.05
NEAR_M = 1e-3
"""Nothing nearer to the camera's plane than this is drawn."""

CUT = -2
"""Origin of an edge of a face that was cut: may be anything."""

_INNER = -1
_SIDES = 32
_RAYS = 128
_BINS = 256
_WIDEST = np.radians(89.0)
# A triangle has 3 corners, one more after the near plane, and at most one more for each side of the field.
_POLYGON = 4 + _SIDES


@dataclass(frozen=True)
class Field:
    """What the lens maps to the sensor.

    normals: (32, 2) and radius: the field on the plane z = 1 is normals @ xy <= radius, a regular polygon; radius is
    infinite where nothing has to be cut. bending: (256,) bound of the second derivative of the image along any
    direction, px per unit squared, in equal bins of the distance from the axis up to the corners of the field.
    """

    normals: Points
    radius: float
    bending: Points

    @property
    def bins(self) -> float:
        """Bins of `bending` per unit of distance from the axis."""
        return len(self.bending) * float(np.cos(np.pi / _SIDES)) / self.radius


def field_of(camera: Camera, low: Points, high: Points) -> Field:
    """Return the field that `camera` maps to the pixels between the corners low and high, (2,) each.

    It ends where the image folds back, if it does so within those pixels: rays further out are lost at the rim of the
    lens, and the polynomial that puts them back into the image means nothing there.
    """
    normals = _directions(_SIDES)
    points = np.tan(np.linspace(0.0, _WIDEST, 500))[:, None, None] * _directions(_RAYS)
    r = points[:, 0, 0]
    if np.array_equal(camera.distort(points.reshape(-1, 2)), points.reshape(-1, 2)):
        return Field(normals, np.inf, np.zeros(_BINS))
    focal, centre = np.diag(camera.K)[:2], camera.K[:2, 2]

    def image(xy: Points) -> Points:
        with np.errstate(all="ignore"):  # a rational model may have poles beyond the field
            return np.asarray(camera.distort(xy.reshape(-1, 2)).reshape(xy.shape) * focal + centre)

    h = 1e-4 * (1 + r[:, None, None])
    J = [(image(points + h * e) - image(points - h * e)) / (2 * h) for e in np.eye(2)]
    opens = J[0][..., 0] * J[1][..., 1] - J[0][..., 1] * J[1][..., 0] > 0
    folds = np.logical_not(opens.all(axis=1))
    fold = r[max(int(np.argmax(folds)) - 1, 1)] if folds.any() else r[-1]
    # A corner may lie between two rays; it is as far off them as they are apart, at most.
    slack = 2 * np.pi / _RAYS * np.linalg.norm(np.maximum(np.abs(low - centre), np.abs(high - centre)))
    uv = image(points)
    inside = np.any(np.all((uv >= low - slack) & (uv <= high + slack), axis=2), axis=1) & (r <= fold)
    need = r[min(int(np.flatnonzero(inside).max(initial=0)) + 1, len(r) - 1)]
    corner = float(np.cos(np.pi / _SIDES))
    radius = float(need if need <= fold * corner else fold * corner)
    return Field(normals, radius, _bending(image, normals, radius / corner))


def _directions(count: int) -> Points:
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _bending(image: Callable[[Points], Points], normals: Points, end: float) -> Points:
    """Bounds of the second derivative of image in bins of the distance from the axis, from 0 to end."""
    r = (np.arange(4 * _BINS) + 0.5) * end / (4 * _BINS)
    points, h = r[:, None, None] * normals, 1e-3 * (1 + r[:, None, None])
    middle = image(points)
    directions = normals[: _SIDES // 2 : 2]
    second = [np.linalg.norm(image(points + h * e) - 2 * middle + image(points - h * e), axis=2) for e in directions]
    bound = (np.max(second, axis=(0, 2)) / h[:, 0, 0] ** 2).reshape(_BINS, 4).max(axis=1)
    # Between its samples, too: a bin also answers for its neighbours.
    padded = np.concatenate([bound[:1], bound, bound[-1:]])
    return np.asarray(np.max([padded[:-2], padded[1:-1], padded[2:]], axis=0))


def neighbours(model: Model) -> NDArray[np.int32]:
    """Return the face beyond the edge opposite to each corner, (F, 3), -1 where not exactly two faces meet.

    Corners that lie within a millionth of the size of the model are one.
    """
    size = float(np.ptp(model.vertices, axis=0).max())
    _, vertex = np.unique(np.round(model.vertices / (1e-6 * size)), axis=0, return_inverse=True)
    faces = vertex.reshape(-1)[model.faces]
    pairs, edges = trimesh.graph.face_adjacency(faces, return_edges=True)  # type: ignore[no-untyped-call]
    beyond = np.full(faces.shape, -1, np.int32)
    for here, there in ((0, 1), (1, 0)):
        corner = (faces[pairs[:, here], :, None] != edges[:, None, :]).all(axis=2).argmax(axis=1)
        beyond[pairs[:, here], corner] = pairs[:, there]
    return beyond


@njit(cache=True, nogil=True)
def cut(polygon, n, side, limit, out):  # type: ignore[no-untyped-def]
    """Keep the part of a convex polygon (Sutherland, Hodgman 1974) where side . (x, y, z) <= limit.

    polygon: (K, 3), its first n rows; side: (3,); out: (K + 1, 3), receives the corners. Returns how many. Points of
    the border are computed from the end that is kept, so that both faces at an edge get the same.
    """
    count = 0
    for i in range(n):
        p, q = polygon[i], polygon[(i + 1) % n]
        dp = side[0] * p[0] + side[1] * p[1] + side[2] * p[2] - limit
        dq = side[0] * q[0] + side[1] * q[1] + side[2] * q[2] - limit
        if dp <= 0.0:
            out[count] = p
            count += 1
        if (dp <= 0.0) != (dq <= 0.0):
            if dp > 0.0:
                p, q, dp, dq = q, p, dq, dp
            for k in range(3):
                out[count, k] = p[k] + (q[k] - p[k]) * (dp / (dp - dq))
            count += 1
    return count


@njit(cache=True, nogil=True)
def excess(a, b, bending, bins):  # type: ignore[no-untyped-def]
    """Bound of how far the image of the edge from a to b, (2,) or more on the plane z = 1, leaves its chord, px."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    length2 = dx * dx + dy * dy
    ra, rb = np.hypot(a[0], a[1]), np.hypot(b[0], b[1])
    nearest = min(ra, rb)
    # The foot of the perpendicular from the axis lies between the ends.
    if abs(ra * ra - rb * rb) < length2:
        nearest = abs(a[0] * b[1] - a[1] * b[0]) / np.sqrt(length2)
    last = len(bending) - 1
    first, end = min(int(nearest * bins), last), min(int(max(ra, rb) * bins), last)
    return 0.125 * length2 * bending[first : end + 1].max()


@njit(cache=True, nogil=True)
def halve(stack, lens, tolerance, out, count):  # type: ignore[no-untyped-def]
    """Halve the longest bent edge of the triangle stack[0] and of its parts until none leaves its chord by more.

    stack: (S, 3, 4), changed. lens: bending and bins of the field. The parts go to out from row `count` on as far as
    there is room; returns the new count, which may be larger than out.
    """
    bending, bins = lens
    top = 1
    while top > 0:
        top -= 1
        longest, edge = 0.0, -1
        for k in range(3):
            p, q = stack[top, k], stack[top, (k + 1) % 3]
            length2 = (q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2
            if length2 > longest and excess(p, q, bending, bins) > tolerance:
                longest, edge = length2, k
        if edge < 0 or top + 2 > len(stack):
            if count < len(out):
                out[count] = stack[top]
            count += 1
            continue
        following, third = (edge + 1) % 3, (edge + 2) % 3
        stack[top + 1] = stack[top]
        for k in range(3):
            middle = 0.5 * (stack[top, edge, k] + stack[top, following, k])
            stack[top, following, k], stack[top + 1, edge, k] = middle, middle
        stack[top, following, 3], stack[top + 1, third, 3] = _INNER, _INNER
        top += 2
    return count


@njit(cache=True, nogil=True)
def visible_part(triangle, field, polygon, spare):  # type: ignore[no-untyped-def]
    """Corners on the plane z = 1 of the part of a triangle (3, 3), camera frame, that lies in the field.

    field: normals and radius. polygon: (P, 3), receives x / z, y / z, 1 / z; spare: (P, 3), scratch. Returns how many,
    and whether that is the whole triangle.
    """
    normals, radius = field
    n = cut(triangle, 3, np.array([0.0, 0.0, -1.0]), -NEAR_M, polygon)
    whole = min(triangle[0, 2], triangle[1, 2], triangle[2, 2]) >= NEAR_M
    outside = False
    for i in range(n):
        w = 1.0 / polygon[i, 2]
        polygon[i, 0] *= w
        polygon[i, 1] *= w
        polygon[i, 2] = w
        outside |= polygon[i, 0] ** 2 + polygon[i, 1] ** 2 > radius * radius
    if not outside:
        return n, whole
    side = np.zeros(3)
    for k in range(len(normals)):
        side[:2] = normals[k]
        n = cut(polygon, n, side, radius, spare)
        polygon[:n] = spare[:n]
    return n, False


@njit(cache=True, nogil=True)
def tessellate(X, faces, field, lens, out, parts):  # type: ignore[no-untyped-def]
    """Cut and halve the faces that look towards the camera.

    X: (V, 3) camera frame, metres; faces: (F, 3), counter-clockwise seen from outside; field: normals and radius.
    lens: bending, bins per unit, and the tolerance in px, infinite where nothing bends. out: (N, 3, 4) triangles:
    x / z, y / z and 1 / z of each corner, and the edge of the face, numbered by the corner opposite, from which the
    edge that begins there comes, -1 for none, CUT where that was not kept. parts: (F, 3), receives the first triangle
    of each face, the one after its last, and 1 where that is the whole face. Returns how many, even if more than N.
    """
    polygon, spare, stack = np.empty((_POLYGON + 1, 3)), np.empty((_POLYGON + 1, 3)), np.empty((128, 3, 4))
    triangle = np.empty((3, 3))
    count = 0
    for f in range(len(faces)):
        for k in range(3):
            for j in range(3):
                triangle[k, j] = X[faces[f, k], j]
        a, b, c = triangle[0], triangle[1], triangle[2]
        volume = (
            a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
        )
        parts[f, 0], parts[f, 1], parts[f, 2] = count, count, 0
        if not volume < 0.0:
            continue
        n, whole = visible_part(triangle, field, polygon, spare)
        for i in range(1, n - 1):
            stack[0, 0, :3], stack[0, 1, :3], stack[0, 2, :3] = polygon[0], polygon[i], polygon[i + 1]
            for k in range(3):
                stack[0, k, 3] = (k + 2) % 3 if whole else CUT
            count = halve(stack, (lens[0], lens[1]), lens[2], out, count)
        parts[f, 1], parts[f, 2] = count, whole and count == parts[f, 0] + 1
    return count
