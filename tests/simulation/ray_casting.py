"""The slow way to the same picture: rays through every sample of the sensor, each asked of every face."""

from __future__ import annotations

import numpy as np
from numba import njit

from esfo_simulation.render.exposure import blur_taps


@njit(cache=True)
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def cast(corners, directions):
    """Nearest face of corners (F, 3, 3) that each ray (N, 3) from the origin hits from the front, -1 for none.

    Moeller, Trumbore 1997, without shortcuts.
    """
    found = np.full(len(directions), -1)
    for n in range(len(directions)):
        nearest, d = np.inf, (directions[n, 0], directions[n, 1], directions[n, 2])
        for f in range(len(corners)):
            a, b, c = corners[f, 0], corners[f, 1], corners[f, 2]
            e1, e2 = (b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2])
            p, q = cross(d, e2), cross(e1, a)
            det = dot(e1, p)
            u, v, t = -dot(a, p), dot(q, d), dot(e2, q)
            if det > 0 and u >= 0 and v >= 0 and u + v <= det and 0 < t < nearest * det:
                nearest, found[n] = t / det, f
    return found


def seen(model, camera, light, uv):
    """Radiance (N,) of the model, in camera coordinates, at image points (N, 2)."""
    directions = np.column_stack([camera.unproject(uv), np.ones(len(uv))])
    face = cast(model.vertices[model.faces], directions)
    facing = np.maximum(model.normals() @ np.array(light.direction), 0)
    return np.append(model.albedo * (light.ambient + light.diffuse * facing), light.background)[face]


def photograph(model, camera, window, light, blur_px, rays=6):
    """Radiance (height, width) of a window: means over samples half a pixel wide, rays x rays each, then the blur."""
    taps = blur_taps(blur_px).astype(float)
    margin = len(taps) // 2 - 1
    x = window.x - 0.5 + (np.arange(rays * (2 * window.width + 2 * margin)) + 0.5) / (2 * rays) - margin / 2
    y = window.y - 0.5 + (np.arange(rays * (2 * window.height + 2 * margin)) + 0.5) / (2 * rays) - margin / 2
    uv = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    fine = seen(model, camera, light, uv).reshape(len(y) // rays, rays, len(x) // rays, rays).mean(axis=(1, 3))
    rows = np.array([taps @ fine[2 * i : 2 * i + len(taps)] for i in range(window.height)])
    return np.array([rows[:, 2 * j : 2 * j + len(taps)] @ taps for j in range(window.width)]).T
