"""Flat-coloured surfaces: planar pieces with an albedo each, from which a model is put together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

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
    the depth test; small against a pixel. inset: range of the distance of a patch's corner from the border of its
    cell, as a share of the cell; below 0.5.
    """

    cells: tuple[int, int]
    base: float
    palette: tuple[float, ...]
    cover: float = 0.9
    raised: float = 4e-4
    inset: tuple[float, float] = (0.08, 0.30)


def plain(albedo: float) -> Mosaic:
    """Return a mosaic without patches."""
    return Mosaic((1, 1), albedo, (albedo,), cover=0.0)


def facing(normal: Sequence[float] | Points, up: Sequence[float] | Points = (0.0, 0.0, 1.0)) -> Points:
    """Return the rotation (3, 3) that takes z to the direction `normal` (3,) and y as close to `up` (3,) as may be.

    Where the two are parallel, y takes the place of `up`.
    """
    z = np.asarray(normal, np.float64) / np.linalg.norm(normal)
    x = np.cross(up, z)
    if np.linalg.norm(x) < 1e-6:
        x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def circle(radius: float, sides: int, center: Sequence[float] = (0.0, 0.0)) -> Points:
    """Return a regular polygon (sides, 2), counter-clockwise, with its first corner at angle 0; metres."""
    angle = 2 * np.pi * np.arange(sides) / sides
    return np.asarray(center + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def rectangle(width: float, height: float, center: Sequence[float] = (0.0, 0.0)) -> Points:
    """Return a rectangle (4, 2), counter-clockwise; metres."""
    return np.asarray(center + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, height / 2])


def rounded(
    width: float, height: float, radii: Sequence[float], steps: int = 5, center: Sequence[float] = (0.0, 0.0)
) -> Points:
    """Return a rectangle with round corners (4 * steps, 2), counter-clockwise; metres.

    radii: of the corners at the lower left, lower right, upper right and upper left.
    """
    quarter = np.linspace(0, np.pi / 2, steps)
    corners = []
    for k, (sign, radius) in enumerate(zip(rectangle(2, 2), radii, strict=True)):
        angle = quarter + np.pi + k * np.pi / 2
        arc = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        corners.append(center + sign * [width / 2 - radius, height / 2 - radius] + arc)
    return np.concatenate(corners)


@dataclass
class Surface:
    """A model in the making: planar convex polygons with an albedo.

    R, T: (3, 3) and (3,) metres, the pose in the model of the coordinates in which polygons are added.
    """

    rng: np.random.Generator
    polygons: list[tuple[Points, float]] = field(default_factory=list)
    R: Points = field(default_factory=lambda: np.eye(3))
    T: Points = field(default_factory=lambda: np.zeros(3))

    def placed(self, T: Sequence[float] | Points, R: Points | None = None) -> Surface:
        """Return the same model with coordinates of its own for a part, at R X + T of the present ones."""
        turned = self.R if R is None else self.R @ R
        return Surface(self.rng, self.polygons, turned, self.R @ np.asarray(T, np.float64) + self.T)

    def polygon(self, corners: Points, albedo: float) -> None:
        """Add a convex polygon; corners (K, 3) counter-clockwise seen from outside."""
        self.polygons.append((np.asarray(corners, np.float64) @ self.R.T + self.T, albedo))

    def quad(self, corners: Points, mosaic: Mosaic) -> None:
        """Add a convex planar quadrilateral (4, 3), counter-clockwise seen from outside, with its mosaic.

        The columns of the mosaic run from the first corner to the second.
        """
        a, b, c, d = corners
        normal = np.cross(c - a, d - b)
        normal /= np.linalg.norm(normal)
        unit_square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
        self.polygon(corners, mosaic.base)
        cells = np.array(mosaic.cells)
        for index in np.ndindex(*mosaic.cells):
            if self.rng.random() > mosaic.cover:
                continue
            # Corners stay in their own cell (neighbours never touch), yet no two patches are alike.
            inset = np.where(unit_square == 0, 1, -1) * self.rng.uniform(*mosaic.inset, (4, 2))
            u, v = ((index + unit_square + inset) / cells).T[:, :, None]
            patch = a + u * (b - a) + v * (d - a) + u * v * (a - b + c - d)
            self.polygon(patch + mosaic.raised * normal, float(self.rng.choice(mosaic.palette)))

    def face(self, origin: Points, edge_u: Points, edge_v: Points, mosaic: Mosaic) -> None:
        """Add a parallelogram with its mosaic; it looks towards edge_u x edge_v. All arguments (3,), metres."""
        self.quad(origin + np.array([0 * edge_u, edge_u, edge_u + edge_v, edge_v]), mosaic)

    def box(self, center: Sequence[float] | Points, axes: Points, mosaic: Mosaic) -> None:
        """Add a box: center (3,), axes (3, 3) with the three half edges (right-handed) as rows; metres."""
        for k in range(3):
            i, j, n = axes[(k + 1) % 3], axes[(k + 2) % 3], axes[k]
            self.face(center + n - i - j, 2 * i, 2 * j, mosaic)
            self.face(center - n - i - j, 2 * j, 2 * i, mosaic)

    def loft(self, rings: Points, mosaics: Sequence[Mosaic]) -> None:
        """Add the closed body between successive convex rings (N, K, 3), the n-th band with mosaics[n], cyclic.

        Each ring turns counter-clockwise when seen from the next one. Both ends are closed with the base of the first
        and of the last band; a ring may shrink to a point. Bands that are not planar take mosaics without patches.
        """
        for n, (low, high) in enumerate(pairwise(rings)):
            mosaic = mosaics[n % len(mosaics)]
            for k in range(len(low)):
                a, b, c, d = low[k - 1], low[k], high[k], high[k - 1]
                if np.array_equal(a, b):
                    self.polygon(np.array([a, c, d]), mosaic.base)
                elif np.array_equal(c, d):
                    self.polygon(np.array([a, b, c]), mosaic.base)
                else:
                    self.quad(np.array([a, b, c, d]), mosaic)
        for ring, mosaic in ((rings[0, ::-1], mosaics[0]), (rings[-1], mosaics[(len(rings) - 2) % len(mosaics)])):
            if np.ptp(ring, axis=0).any():
                self.polygon(ring, mosaic.base)

    def revolve(self, profile: Sequence[tuple[float, float]], sides: int, mosaics: Sequence[Mosaic]) -> None:
        """Add the body that the profile, (radius, z) in metres from its lowest end upwards, sweeps about z."""
        self.loft(np.array([np.insert(circle(radius, sides), 2, z, axis=1) for radius, z in profile]), mosaics)

    def extrude(self, outline: Points, low: float, high: float, mosaics: Sequence[Mosaic]) -> None:
        """Add the closed prism over a convex outline (K, 2), counter-clockwise, from z = low to high; metres."""
        self.loft(np.array([np.insert(outline, 2, z, axis=1) for z in (low, high)]), mosaics)

    def decal(self, outline: Points, albedo: float, height: float = 2e-4) -> None:
        """Add a flat mark with a convex outline (K, 2), counter-clockwise, that looks towards z, at z = height."""
        self.polygon(np.insert(outline, 2, height, axis=1), albedo)

    def panel(
        self, width: float, height: float, mosaic: Mosaic, center: Sequence[float] = (0.0, 0.0), z: float = 2e-4
    ) -> None:
        """Add a rectangle with its mosaic that looks towards z, at that z; metres."""
        self.quad(np.insert(rectangle(width, height, center), 2, z, axis=1), mosaic)

    def rod(self, start: Sequence[float] | Points, end: Sequence[float] | Points, radius: float, albedo: float) -> None:
        """Add a closed six-sided rod between two points (3,); metres."""
        along = np.subtract(end, start)
        part = self.placed(start, facing(along))
        part.revolve([(radius, 0.0), (radius, float(np.linalg.norm(along)))], 6, [plain(albedo)])

    def prism(self, radius: float, low: float, high: float, sides: int, mosaic: Mosaic) -> Points:
        """Add the side faces of a regular prism about z; return its rim (sides, 2) in the x-y plane."""
        rim = circle(radius, sides)
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
