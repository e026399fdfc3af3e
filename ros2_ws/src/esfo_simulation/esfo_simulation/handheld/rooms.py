"""What a hand-held camera looks at: `shapes`, `poster` and `boxes` in the manner of the Event Camera Dataset.

Mueggler et al., "The Event-Camera Dataset and Simulator", IJRR 2017. World frame: x right, y ahead, z up, metres; the
camera rests in the origin and looks along y. Light comes from everywhere and stays with the room, so a surface keeps
its radiance while the camera moves: render with `EVEN_LIGHT`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from esfo_core.errors import SimulationError
from esfo_core.orbit import rotation
from esfo_simulation.handheld.texture import grains, voronoi_cells
from esfo_simulation.render.renderer import Light
from esfo_simulation.render.surface import Model, Mosaic, Points, Surface, circle, facing

EVEN_LIGHT = Light(ambient=1.0, diffuse=0.0)
"""Illumination of the rooms: what depends on the direction of a surface is in its albedo already."""

WALL_M = 10.0
"""Width and height of the walls of `shapes` and `poster`, 1 m ahead: more than a DAVIS240C sees from any pose."""

CORNER_TURN_DEG = 20.0
"""Turn of an outline from which on a vertex counts as a corner; the polygons that stand for circles turn by less."""

_Z = np.array([0.0, 0, 1])
_AHEAD = facing((0.0, -1.0, 0.0))
_PITCH_M = 0.34
_BOX_PATCHES = (0.08, 0.15, 0.3, 0.75, 0.95)


def shapes(seed: int) -> Model:
    """Return dark simple shapes, each within a square of 0.34 m, on a bright wall."""
    surface = Surface(np.random.default_rng(seed))
    wall = surface.placed((0.0, 1.0, 0.0), _AHEAD)
    wall.polygon(WALL_M / 2 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]), 0.8)
    rng, count = surface.rng, int(WALL_M / _PITCH_M)
    for index in np.ndindex(count, count):
        radius = rng.uniform(0.07, 0.13)
        middle = (np.array(index) + 0.5 - count / 2) * _PITCH_M + rng.uniform(-0.03, 0.03, 2)
        turn = rotation(_Z, rng.uniform(0, 2 * np.pi))[:2, :2]
        albedo = rng.uniform(0.05, 0.2)
        for piece in _SHAPES[rng.integers(len(_SHAPES))]:
            wall.decal(radius * piece @ turn.T + middle, albedo)
    return surface.build()


def _star(tips: int, inner: float) -> list[Points]:
    rim = circle(inner, tips)
    half = rotation(_Z, np.pi / tips)[:2, :2]
    points = circle(1.0, tips) @ half.T
    return [rim, *(np.array([rim[k], points[k], rim[(k + 1) % tips]]) for k in range(tips))]


# Convex pieces of unit radius that meet only in corners of the outline, so that every vertex is one of the shape.
_SHAPES = (
    [circle(1.0, 3)],
    [circle(1.0, 4)],
    [circle(1.0, 6)],
    [circle(0.9, 32)],
    [np.array([[-0.9, -0.4], [0.9, -0.4], [0.9, 0.4], [-0.9, 0.4]])],
    _star(5, 0.45),
    [
        np.array([[-0.8, -0.8], [0.8, -0.8], [0.8, -0.1], [-0.1, -0.1]]),
        np.array([[-0.8, -0.8], [-0.1, -0.1], [-0.1, 0.8], [-0.8, 0.8]]),
    ],
)


def poster(seed: int) -> Model:
    """Return a wall that is one irregular texture, like broken rock: some thousand grey cells, finest ahead."""
    surface = Surface(np.random.default_rng(seed))
    rng = surface.rng
    # As dense in the image at the edge, where the view is oblique, as in front: uniform in the angle, roughly.
    distance = np.sqrt(1 / (1 - rng.uniform(0, 0.985, 6000)) ** 2 - 1)
    angle = rng.uniform(0, 2 * np.pi, len(distance))
    points = distance[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = points[(np.abs(points) < WALL_M / 2).all(axis=1)]
    _paint(surface.placed((0.0, 1.0, 0.0), _AHEAD), points, WALL_M / 2 * np.ones(2))
    return surface.build()


def boxes(seed: int) -> Model:
    """Return stacks of boxes with patches, at 0.75 to 2.3 m, on the carpet of a closed room with textured walls."""
    surface = Surface(np.random.default_rng(seed))
    rng = surface.rng
    low, high = np.array([-2.2, -0.8, -0.6]), np.array([2.2, 2.6, 1.8])
    for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)):
        inward = -sign * np.eye(3)[axis]
        frame = facing(inward)
        center = (low + high) / 2
        center[axis] = high[axis] if sign > 0 else low[axis]
        half = np.abs((high - low) / 2 @ frame)[:2]
        most_seen = (axis, sign) in ((1, 1.0), (2, -1.0))
        points = rng.uniform(-half, half, (int(4 * half.prod() * (140 if most_seen else 40)), 2))
        _paint(surface.placed(center, frame), points, half)
    for y, count, storeys in ((2.0, 6, 3), (1.5, 5, 2), (1.0, 4, 1)):
        for x in (np.arange(count) - (count - 1) / 2) * 0.62 * (y + 0.6) / 2:
            _stack(surface, np.array([x, y, low[2]]) + rng.uniform(-0.07, 0.07, 3) * [1, 1, 0], storeys)
    return _lit(surface.build())


ROOMS: dict[str, Callable[[int], Model]] = {"shapes": shapes, "poster": poster, "boxes": boxes}


def corners(model: Model) -> Points:
    """Return the points (N, 3) where an outline of a patch turns by more than `CORNER_TURN_DEG`, each once.

    Whether something stands before them is not asked. The model is one that `Surface` builds, where every polygon has
    vertices of its own; raises SimulationError for any other.
    """
    first, second, third = model.faces.T
    start = np.unique(first)
    size = np.diff([*start, len(model.vertices)])
    if len(start) == 0 or start[0] or (third != second + 1).any() or len(model.faces) != (size - 2).sum():
        raise SimulationError(f"the {len(model.faces)} faces are no polygons with vertices of their own")
    index = np.arange(len(model.vertices))
    previous, following = index - 1, index + 1
    previous[start] = start + size - 1
    following[start + size - 1] = start
    before = model.vertices - model.vertices[previous]
    after = model.vertices[following] - model.vertices
    cosine = (before * after).sum(axis=1) / (np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1))
    found = model.vertices[cosine < np.cos(np.radians(CORNER_TURN_DEG))]
    _, once = np.unique(np.round(found, 6), axis=0, return_index=True)
    return np.asarray(found[np.sort(once)])


def _paint(wall: Surface, points: Points, half: Points) -> None:
    """Cover the rectangle from -half to half (2,) with the cells around the points (N, 2), metres."""
    greys = grains(points, wall.rng)
    for cell, grey in zip(voronoi_cells(points, half), greys, strict=True):
        wall.decal(cell, float(grey), height=0.0)


def _stack(surface: Surface, foot: Points, storeys: int) -> None:
    """Put boxes on each other, each turned on its own and smaller than the one below."""
    half = surface.rng.uniform([0.17, 0.13, 0.14], [0.22, 0.18, 0.24])
    for _ in range(storeys):
        axes = half[:, None] * rotation(_Z, surface.rng.uniform(-0.5, 0.5)).T
        base = float(surface.rng.uniform(0.4, 0.6))
        surface.box(foot + half * _Z, axes, Mosaic((3, 4), base, _BOX_PATCHES, cover=0.85))
        foot = foot + 2 * half * _Z
        half = half * surface.rng.uniform(0.75, 0.9, 3)


def _lit(model: Model) -> Model:
    """Return the model with its albedo dimmed by a lamp that hangs behind the camera, to the left."""
    lamp = np.array([-0.4, -0.6, 0.69])
    return Model(model.vertices, model.faces, model.albedo * (0.6 + 0.4 * np.maximum(model.normals() @ lamp, 0.0)))
