"""True tracks: where corners of the model's surface are seen, and when they are hidden."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.camera import Camera
from esfo_core.orbit import Matrix, Vector
from esfo_core.tracks import Tracks
from esfo_simulation.motion import RigidMotion
from esfo_simulation.render.surface import Model

_TOLERANCE = 1e-4
"""A surface hides a point when it is nearer by more than this share of the distance: a patch lies on its own face."""

_STRAIGHT = (150.0, 210.0)
"""Degrees: a sector between these has a straight border."""

_AROUND = 340.0
"""Degrees: a sector beyond has no border."""

_ALIKE = float(np.cos(np.radians(20)))
"""Faces whose normals differ by less than 20 degrees continue each other: a round body has 18 sides or more."""

SIGMA_PX = 1e-3
"""Standard deviation that the rows of true tracks state: they are exact."""


@njit(cache=True, nogil=True)
def occluded(uv, inverse_depth, faces, points, hidden):  # type: ignore[no-untyped-def]
    """Mark points that a triangle hides.

    uv: (V, 2) image of the vertices; inverse_depth: (V,) 1/z, linear over the image of a plane; faces: (F, 3);
    points: (P,) indices into the vertices; hidden: (P,), set to True where a triangle that faces the camera is in front
    of the point.
    """
    for f in range(len(faces)):
        ia, ib, ic = faces[f]
        ax, ay, bx, by, cx, cy = uv[ia, 0], uv[ia, 1], uv[ib, 0], uv[ib, 1], uv[ic, 0], uv[ic, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area >= 0.0:  # turned away: y points down
            continue
        x0, x1, y0, y1 = min(ax, bx, cx), max(ax, bx, cx), min(ay, by, cy), max(ay, by, cy)
        for k in range(len(points)):
            x, y = uv[points[k], 0], uv[points[k], 1]
            if hidden[k] or x < x0 or x > x1 or y < y0 or y > y1:
                continue
            wa = (bx - x) * (cy - y) - (by - y) * (cx - x)
            wb = (cx - x) * (ay - y) - (cy - y) * (ax - x)
            wc = (ax - x) * (by - y) - (ay - y) * (bx - x)
            if wa > 0.0 or wb > 0.0 or wc > 0.0:
                continue
            z = (wa * inverse_depth[ia] + wb * inverse_depth[ib] + wc * inverse_depth[ic]) / area
            hidden[k] = z > inverse_depth[points[k]] * (1.0 + _TOLERANCE)


def corner_vertices(model: Model) -> NDArray[np.int64]:
    """Return the vertices at which a corner is seen, one for each place: sorted indices (P,).

    All faces at a place that are of one albedo and of nearly one direction form a sector; a place is a corner when the
    border of one of its sectors turns there, like that of a patch, a plate or a box. A smooth round body of one albedo
    has none.
    """
    _, first, place = np.unique(model.vertices, axis=0, return_index=True, return_inverse=True)
    place = place.ravel()
    a = model.vertices[model.faces]
    before, after = np.roll(a, 1, axis=1) - a, np.roll(a, -1, axis=1) - a
    cosine = np.einsum("fki,fki->fk", before, after)
    angle = np.arccos(
        np.clip(cosine / np.maximum(np.linalg.norm(before, axis=2) * np.linalg.norm(after, axis=2), 1e-300), -1, 1)
    ).ravel()
    at, face = place[model.faces].ravel(), np.repeat(np.arange(len(model.faces)), 3)
    order = np.argsort(at, kind="stable")
    normals = model.normals()
    found = []
    for rows in np.split(order, np.flatnonzero(np.diff(at[order])) + 1):
        f = face[rows]
        alike = (normals[f] @ normals[f].T > _ALIKE) & (model.albedo[f][:, None] == model.albedo[f])
        sector = np.degrees(alike @ angle[rows])
        if ((sector < _STRAIGHT[0]) | ((sector > _STRAIGHT[1]) & (sector < _AROUND))).any():
            found.append(first[at[rows[0]]])
    return np.sort(np.array(found, np.int64))


def choose_points(model: Model, count: int, seed: int) -> NDArray[np.int64]:
    """Draw at most `count` of the corners of the model, or of all its vertices if it has no corner: sorted indices."""
    found = corner_vertices(model)
    if not len(found):
        found = np.unique(model.vertices, axis=0, return_index=True)[1]
    rng = np.random.default_rng([seed, 2])
    return np.sort(rng.choice(found, min(count, len(found)), replace=False))


def visible(
    model: Model, points: NDArray[np.int64], camera: Camera, pose: tuple[Matrix, Vector]
) -> tuple[Matrix, NDArray[np.bool_]]:
    """Return the image (P, 2) px of the vertices `points` (P,), and which of them are seen from the camera.

    A point is seen when it lies in front of the camera, within the image, and no surface that faces the camera hides
    it. Lens distortion is taken to leave the small triangles straight.
    """
    R, T = pose
    X = model.vertices @ R.T + T
    front = X[:, 2] > 1e-3
    uv = camera.project(np.where(front[:, None], X, [0.0, 0.0, 1.0]))
    hidden = ~front[points]
    faces = model.faces[front[model.faces].all(axis=1)]
    occluded(uv, 1 / np.where(front, X[:, 2], np.inf), faces, points, hidden)
    at = uv[points]
    inside = ((at >= 0) & (at <= [camera.width - 1, camera.height - 1])).all(axis=1)
    return at, inside & ~hidden & _faces_camera(model, points, X)


def _faces_camera(model: Model, points: NDArray[np.int64], X: Matrix) -> NDArray[np.bool_]:
    """Whether any face at each of the points is turned to the camera; X: (V, 3) vertices in its frame."""
    a, b, c = (X[model.faces[:, k]] for k in range(3))
    towards = np.einsum("fi,fi->f", np.cross(b - a, c - a), a) < 0
    seen = np.zeros(len(model.vertices), bool)
    seen[model.faces[towards]] = True
    return np.asarray(seen[points])


def true_tracks(
    model: Model, points: NDArray[np.int64], camera: Camera, motion: RigidMotion, times: NDArray[np.int64]
) -> Tracks:
    """Return where the points (P,) are seen at `times` (N,) ns: track k is point k, with rows only where it is seen."""
    parts = []
    for t in times:
        uv, seen = visible(model, points, camera, motion.pose(float(t)))
        k = np.flatnonzero(seen)
        parts.append(Tracks.from_columns(k, np.full(len(k), t), uv[k], np.full(len(k), SIGMA_PX)))
    return Tracks.concatenate(parts).sorted()
