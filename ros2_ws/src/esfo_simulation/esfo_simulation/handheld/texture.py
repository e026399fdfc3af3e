"""Irregular textures: the cells of a Voronoi diagram, with greys that vary on two scales."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, Voronoi, cKDTree

from esfo_simulation.render.surface import Points

_SNAP_M = 1e-3
_CELLS_PER_GRAIN = 12


def voronoi_cells(points: Points, half: Points) -> list[Points]:
    """Return the Voronoi cell (K, 2), counter-clockwise, of each of the points (N, 2) within -half..half (2,), metres.

    Cells cover the rectangle up to 1 mm, the grid on which their corners lie, so that no edge is shorter.
    """
    # Mirrored at its sides, the points have the sides themselves as borders between them.
    flips = [(0, half[0]), (0, -half[0]), (1, half[1]), (1, -half[1])]
    mirrored = [np.where(np.arange(2) == axis, 2 * side - points, points) for axis, side in flips]
    diagram = Voronoi(np.concatenate([points, *mirrored]))
    vertices = np.round(diagram.vertices / _SNAP_M) * _SNAP_M
    cells = []
    for region in diagram.point_region[: len(points)]:
        corners = np.unique(vertices[diagram.regions[region]], axis=0)
        cells.append(corners[ConvexHull(corners).vertices])
    return cells


def grains(points: Points, rng: np.random.Generator) -> Points:
    """Return albedos (N,) of cells around the points (N, 2): about a dozen neighbours differ little, like a grain."""
    centers = points[rng.choice(len(points), max(len(points) // _CELLS_PER_GRAIN, 1), replace=False)]
    _, nearest = cKDTree(centers).query(points)
    coarse = np.exp(rng.uniform(np.log(0.12), np.log(0.8), len(centers)))[nearest]
    return np.asarray(np.clip(coarse * np.exp(0.5 * rng.standard_normal(len(points))), 0.05, 0.95))
