"""When to render frames for a camera that moves inside of a scene, most of which it does not see."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import trimesh
from numba import njit
from scipy.ndimage import maximum_filter1d
from scipy.spatial import cKDTree

from esfo_core.camera import Camera
from esfo_core.events import NS_PER_S
from esfo_core.orbit import Matrix, Vector
from esfo_simulation.motion import RigidMotion
from esfo_simulation.render.surface import Model
from esfo_simulation.simulator import LARGEST_STEP_PX, LONGEST_STEP_NS

SAMPLE_NS = 5e6
"""Time between two looks at the motion: a small part of the period of the fastest shake of a hand, 0.2 s."""

NEAR_M = 0.02
"""Depth from which on a point counts as before the camera."""

_SPACING_RAD = 0.08
_MARGIN_PX = 8.0  # about half the spacing: the largest motion is at the border, where no point may be by chance
_EYES = 5


def surface_points(model: Model, eyes: Matrix) -> Matrix:
    """Return points (N, 3) that cover the surface: all vertices, and more where these are far apart.

    Seen from the nearest of the eyes (M, 3), metres, an edge between neighbours is about 0.08 rad or less.
    """
    split: Any = trimesh.remesh.subdivide  # untyped
    vertices, faces = model.vertices, model.faces
    found = [vertices]
    while len(faces):
        corners = vertices[faces]
        edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        distance, _ = cKDTree(eyes).query(corners.mean(axis=1))
        faces = faces[edge > _SPACING_RAD * np.maximum(distance, NEAR_M)]
        vertices, faces = split(vertices, faces)
        found.append(vertices)
    return np.asarray(np.unique(np.round(np.concatenate(found), 6), axis=0))


@njit(cache=True, nogil=True)
def select_ahead(points, R, T, low, high, index, moved):  # type: ignore[no-untyped-def]
    """Move the points (N, 3) by R, T and keep those beyond `NEAR_M` whose x/z, y/z are within low..high (2,).

    Writes which these are to index (N,) and where they come to moved (N, 3); returns how many.
    """
    n = 0
    for i in range(len(points)):
        x, y, z = points[i]
        depth = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + T[2]
        right = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + T[0]
        down = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + T[1]
        if depth > NEAR_M and low[0] * depth < right < high[0] * depth and low[1] * depth < down < high[1] * depth:
            index[n] = i
            moved[n, 0], moved[n, 1], moved[n, 2] = right, down, depth
            n += 1
    return n


def frame_times_in_view(motion: RigidMotion, model: Model, camera: Camera, span: tuple[float, float]) -> Vector:
    """Choose times (K,) in ns, both ends of the span included, so that nothing in view moves by more than half a pixel.

    As many as needed: between two times the fastest visible point moves by `LARGEST_STEP_PX`, unless
    `LONGEST_STEP_NS` ends first. Surfaces that others hide count as visible.
    Raises CameraError where the lens distortion cannot be inverted at the border of the image.
    """
    eyes = np.array([-T @ R for R, T in map(motion.pose, np.linspace(*span, _EYES))])
    points, view = surface_points(model, eyes), _View(camera)
    grid = np.linspace(*span, max(int(np.ceil((span[1] - span[0]) / SAMPLE_NS)), 1) + 1)
    steps = np.array([view.largest_shift(points, motion, a, b) for a, b in pairwise(grid)])
    # Within an interval the speed may reach that of its neighbours.
    steps = maximum_filter1d(steps / LARGEST_STEP_PX, 3, mode="nearest")
    done = np.concatenate([[0.0], np.cumsum(np.maximum(steps, np.diff(grid) / LONGEST_STEP_NS))])
    count = int(np.ceil(done[-1] - 1e-9))
    return np.asarray(np.interp(np.linspace(0, done[-1], count + 1), done, grid))


def image_speed(motion: RigidMotion, points: Matrix, camera: Camera, t: float) -> float:
    """Return the largest image speed in px/s among those of the points (N, 3) that are in view at `t` ns."""
    half = 1e4  # ns: an angle below 1e-3 rad for every motion slower than 100 rad/s
    return _View(camera).largest_shift(points, motion, t - half, t + half) / (2 * half / NS_PER_S)


class _View:
    """Tells which points a camera sees.

    A distorted position alone does not: a polynomial takes some points far outside back into the image. So the ideal
    one must be within the box round the border of the image, too.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._size = np.array([camera.width, camera.height])
        left, right = -_MARGIN_PX, camera.width - 1 + _MARGIN_PX
        top, bottom = -_MARGIN_PX, camera.height - 1 + _MARGIN_PX
        share = np.linspace(0, 1, 50)[:, None]
        ring = np.array([[left, top], [right, top], [right, bottom], [left, bottom], [left, top]])
        border = camera.unproject(np.concatenate([a + share * (b - a) for a, b in pairwise(ring)]))
        self._low, self._high = border.min(axis=0), border.max(axis=0)

    def largest_shift(self, points: Matrix, motion: RigidMotion, begin: float, end: float) -> float:
        """Return by how many pixels a point (N, 3) of those in view at `begin` moves at most until `end`, ns."""
        index, before = np.empty(len(points), np.int64), np.empty(points.shape)
        n = select_ahead(points, *motion.pose(begin), self._low, self._high, index, before)
        first = self._camera.project(before[:n])
        seen = np.flatnonzero(((first > -_MARGIN_PX) & (first < self._size - 1 + _MARGIN_PX)).all(axis=1))
        R, T = motion.pose(end)
        after = points[index[seen]] @ R.T + T
        still = after[:, 2] > NEAR_M
        shift = self._camera.project(after[still]) - first[seen[still]]
        return float(np.linalg.norm(shift, axis=1).max(initial=0.0))
