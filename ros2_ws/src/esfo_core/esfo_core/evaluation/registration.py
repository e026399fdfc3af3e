"""Registration of a sparse reconstruction to the true mesh (paper, section 6.4): ICP over similarities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from esfo_core.errors import EsfoError
from esfo_core.orbit import Matrix, Spin, Vector, object_frame, rotation

_SAMPLES = 50_000
_CANDIDATES = 4
"""Faces, those of the nearest samples, whose exact distance is taken."""
_PHASES = 24
_COARSE, _FINE = 8, 60
_LEAST_POINTS = 4


class RegistrationError(EsfoError):
    """The points or the mesh do not determine a registration."""


@dataclass(frozen=True)
class Registration:
    """Similarity T (4, 4) from the points to the mesh, and the distance (P,) of each point after it.

    diameter: largest distance of two vertices' bounding corners of the mesh; both in the units of the mesh.
    """

    T: Matrix
    distance: Vector
    diameter: float

    @property
    def mean_percent(self) -> float:
        """Mean distance in percent of the diameter, the paper's measure."""
        return 100 * float(self.distance.mean()) / self.diameter

    @property
    def median_percent(self) -> float:
        """Median distance in percent of the diameter, which a few wrong points do not move."""
        return 100 * float(np.median(self.distance)) / self.diameter


class MeshSurface:
    """Nearest points of a triangle mesh, exact but for the choice of the face among those of the nearest samples."""

    def __init__(self, mesh: trimesh.Trimesh, seed: int = 0) -> None:
        samples, face = trimesh.sample.sample_surface(mesh, _SAMPLES, seed=seed)
        self._tree = cKDTree(np.asarray(samples))
        self._face: NDArray[np.int64] = np.asarray(face)
        self._triangles = np.asarray(mesh.triangles)
        self.diameter = float(np.linalg.norm(mesh.bounds[1] - mesh.bounds[0]))

    def nearest(self, points: Matrix) -> Matrix:
        """Return the point (P, 3) of the surface nearest to each of `points` (P, 3)."""
        _, near = self._tree.query(points, _CANDIDATES)
        triangles = self._triangles[self._face[near.ravel()]]
        repeated = np.repeat(points, _CANDIDATES, axis=0)
        found = trimesh.triangles.closest_point(triangles, repeated).reshape(-1, _CANDIDATES, 3)  # type: ignore[no-untyped-call]
        best = np.argmin(np.linalg.norm(found - points[:, None], axis=2), axis=1)
        return np.asarray(found[np.arange(len(points)), best])


def register(points: Matrix, estimated: Spin, surface: MeshSurface, true: Spin) -> Registration:
    """Align (P, 3) points of an estimate with the true surface and measure the remaining distances.

    points: camera-aligned, origin at estimated.center. surface: camera-aligned, origin at true.center. Axes are laid
    on one another and the radii of the orbits made equal; from there, at 24 phases, because the phase of an object is a
    convention, rotation, translation and scale follow by ICP. Distances weigh as in Huber's loss at their median, so
    that false points do not turn the object. Raises RegistrationError for less than 4 points.
    """
    if len(points) < _LEAST_POINTS:
        raise RegistrationError(f"{len(points)} points cannot be registered; {_LEAST_POINTS} are needed")
    start = [
        _refine(points, _start(estimated, true, 2 * np.pi * k / _PHASES), surface, _COARSE) for k in range(_PHASES)
    ]
    best = min(start, key=lambda T: float(np.median(_distance(points, T, surface))))
    T = _refine(points, best, surface, _FINE)
    return Registration(T, _distance(points, T, surface), surface.diameter)


def _start(estimated: Spin, true: Spin, phase: float) -> Matrix:
    scale = _radius(true) / _radius(estimated)
    R = rotation(true.axis, phase) @ object_frame(true.axis) @ object_frame(estimated.axis).T
    along = scale * (estimated.center @ estimated.axis) - true.center @ true.axis
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = scale * R, along * true.axis
    return T


def _radius(spin: Spin) -> float:
    return float(np.linalg.norm(np.cross(spin.center, spin.axis)))


def _apply(T: Matrix, points: Matrix) -> Matrix:
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def _distance(points: Matrix, T: Matrix, surface: MeshSurface) -> Vector:
    moved = _apply(T, points)
    return np.asarray(np.linalg.norm(surface.nearest(moved) - moved, axis=1))


def _refine(points: Matrix, T: Matrix, surface: MeshSurface, iterations: int) -> Matrix:
    """Iterate nearest points and the weighted similarity between them (Procrustes)."""
    for _ in range(iterations):
        moved = _apply(T, points)
        nearest = surface.nearest(moved)
        distance = np.linalg.norm(nearest - moved, axis=1)
        weights = 1 / np.maximum(distance, max(float(np.median(distance)), 1e-12))
        step, _, _ = trimesh.registration.procrustes(moved, nearest, weights=weights, reflection=False)
        T = np.asarray(step) @ T
    return T
