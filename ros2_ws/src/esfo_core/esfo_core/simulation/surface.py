"""Flat-coloured surfaces: planar pieces with an albedo each, from which a model is put together."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import trimesh
from numpy.typing import NDArray

Points = NDArray[np.float64]


@dataclass(frozen=True)
class Model:
    """A triangle mesh with one albedo per face.

    vertices: (V, 3) metres. faces: (F, 3) int32, counter-clockwise seen from outside. albedo: (F,) in (0, 1].
    """

    vertices: Points
    faces: NDArray[np.int32]
    albedo: Points

    def normals(self) -> Points:
        """Return the outward unit normals, (F, 3)."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        n = np.cross(b - a, c - a)
        return np.asarray(n / np.linalg.norm(n, axis=1, keepdims=True))

    def moved(self, R: Points, translation: Points) -> Model:
        """Return the model with every vertex X taken to R X + translation."""
        return Model(self.vertices @ R.T + translation, self.faces, self.albedo)

    def to_trimesh(self) -> trimesh.Trimesh:
        """Return the same mesh with grey face colours; vertices and faces keep their order."""
        grey = np.round(self.albedo * 255).astype(np.uint8)
        colors = np.stack([grey, grey, grey, np.full_like(grey, 255)], axis=1)
        return trimesh.Trimesh(self.vertices, self.faces, face_colors=colors, process=False)


@dataclass(frozen=True)
class Mosaic:
    """Irregular patches on a face: what an event camera sees as corners.

    cells: number of patches along the two edges. base: albedo between them. palette: albedos to draw from.
    cover: share of the cells that carry a patch. raised: height over the face in metres, so that patches win
    the depth test; small against a pixel.
    """

    cells: tuple[int, int]
    base: float
    palette: tuple[float, ...]
    cover: float = 0.9
    raised: float = 4e-4


@dataclass
class Surface:
    """A model in the making: planar convex polygons with an albedo."""

    rng: np.random.Generator
    polygons: list[tuple[Points, float]] = field(default_factory=list)

    def polygon(self, corners: Points, albedo: float) -> None:
        """Add a convex polygon; corners (K, 3) counter-clockwise seen from outside."""
        self.polygons.append((np.asarray(corners, np.float64), albedo))

    def face(self, origin: Points, edge_u: Points, edge_v: Points, mosaic: Mosaic) -> None:
        """Add a parallelogram with its mosaic; it looks towards edge_u x edge_v. All arguments (3,), metres."""
        normal = np.cross(edge_u, edge_v)
        normal /= np.linalg.norm(normal)
        unit_square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])

        def place(uv: Points, height: float) -> Points:
            return np.asarray(origin + uv[:, :1] * edge_u + uv[:, 1:] * edge_v + height * normal)

        self.polygon(place(unit_square, 0.0), mosaic.base)
        cells = np.array(mosaic.cells)
        for index in np.ndindex(*mosaic.cells):
            if self.rng.random() > mosaic.cover:
                continue
            # Corners stay in their own cell (neighbours never touch), yet no two patches are alike.
            inset = np.where(unit_square == 0, 1, -1) * self.rng.uniform(0.08, 0.30, (4, 2))
            patch = (index + unit_square + inset) / cells
            self.polygon(place(patch, mosaic.raised), float(self.rng.choice(mosaic.palette)))

    def box(self, center: Points, axes: Points, mosaic: Mosaic) -> None:
        """Add a box: center (3,), axes (3, 3) with the three half edges (right-handed) as rows; metres."""
        for k in range(3):
            i, j, n = axes[(k + 1) % 3], axes[(k + 2) % 3], axes[k]
            self.face(center + n - i - j, 2 * i, 2 * j, mosaic)
            self.face(center - n - i - j, 2 * j, 2 * i, mosaic)

    def prism(self, radius: float, low: float, high: float, sides: int, mosaic: Mosaic) -> Points:
        """Add the side faces of a regular prism about z; return its rim (sides, 2) in the x-y plane."""
        angle = 2 * np.pi * np.arange(sides) / sides
        rim = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        up = np.array([0, 0, high - low])
        for a, b in zip(rim, np.roll(rim, -1, axis=0), strict=True):
            self.face(np.array([*a, low]), np.array([*(b - a), 0.0]), up, mosaic)
        return rim

    def cone(self, apex: Points, rim: Points, albedos: tuple[float, ...]) -> None:
        """Add a fan from apex (3,) to the closed rim (K, 3), its sectors cycling through the albedos."""
        for k, (a, b) in enumerate(zip(rim, np.roll(rim, -1, axis=0), strict=True)):
            self.polygon(np.array([apex, a, b]), albedos[k % len(albedos)])

    def build(self) -> Model:
        """Triangulate what was added."""
        vertices = np.concatenate([corners for corners, _ in self.polygons])
        faces: list[tuple[int, int, int]] = []
        albedo: list[float] = []
        start = 0
        for corners, value in self.polygons:
            faces += [(start, start + k, start + k + 1) for k in range(1, len(corners) - 1)]
            albedo += [value] * (len(corners) - 2)
            start += len(corners)
        return Model(vertices, np.array(faces, np.int32), np.array(albedo))
