"""Triangles to samples: which face is nearest at every point of a grid."""

from __future__ import annotations

import numpy as np
from numba import njit

# Columns of a plane: three edges a, b, c with a x + b y + c <= 0 inside, then 1/z as the same kind of sum, then
# from which edge of its face each edge comes.
PLANE = 15
EDGES = 12
# A triangle of less area, in samples, almost never has one; its slopes are only rounding errors.
_SMALLEST = 1e-6


@njit(cache=True, nogil=True)
def set_plane(t, plane):  # type: ignore[no-untyped-def]
    """Edges and depth of the triangle t (3, 4) into plane (15,); False if not to be drawn."""
    area = (t[1, 0] - t[0, 0]) * (t[2, 1] - t[0, 1]) - (t[1, 1] - t[0, 1]) * (t[2, 0] - t[0, 0])
    # v points down: what is counter-clockwise seen from outside has negative area here.
    if not area < 0.0:
        plane[:] = 0.0
        return False
    gx, gy = 0.0, 0.0
    for k in range(3):
        p, q = t[(k + 1) % 3], t[(k + 2) % 3]
        a, b = p[1] - q[1], q[0] - p[0]
        plane[3 * k], plane[3 * k + 1], plane[3 * k + 2] = a, b, -(a * p[0] + b * p[1])
        plane[EDGES + k] = p[3]
        gx += a * (t[k, 2] - t[0, 2]) / area
        gy += b * (t[k, 2] - t[0, 2]) / area
    plane[9], plane[10], plane[11] = gx, gy, t[0, 2] - gx * t[0, 0] - gy * t[0, 1]
    return area < -_SMALLEST


@njit(cache=True, nogil=True)
def from_top(t):  # type: ignore[no-untyped-def]
    """Indices of the corners of t (3, 4) by v, then u: every edge is walked alike, whichever face it belongs to."""
    i, j, k = 0, 1, 2
    if (t[j, 1], t[j, 0]) < (t[i, 1], t[i, 0]):
        i, j = j, i
    if (t[k, 1], t[k, 0]) < (t[j, 1], t[j, 0]):
        j, k = k, j
        if (t[j, 1], t[j, 0]) < (t[i, 1], t[i, 0]):
            i, j = j, i
    return i, j, k


@njit(cache=True, nogil=True)
def along(p, q, y):  # type: ignore[no-untyped-def]
    """Abscissa of the line from p down to q at ordinate y."""
    height = q[1] - p[1]
    return p[0] + (y - p[1]) * ((q[0] - p[0]) / height) if height > 0.0 else p[0]


@njit(cache=True, nogil=True)
def rasterize(corners, planes, ids, depth, extent):  # type: ignore[no-untyped-def]
    """Draw triangles, keeping what is nearest.

    corners: (M, 3, 4) u, v of the grid, whose samples are the integers, 1/z, which is linear over the image of a plane,
    and the origin of the edge that begins there. Changed in place: planes (M + 1, 15), where triangle m that is drawn
    sets row m + 1; ids (H, W), the row of the triangle, 0 where there is none; depth (H, W), 1/z; extent (H, 2), first
    and last column that was drawn to.
    """
    height, width = ids.shape
    ramp = np.arange(width).astype(np.float32)
    for m in range(len(corners)):
        t, plane = corners[m], planes[m + 1]
        if not set_plane(t, plane):
            continue
        i, j, k = from_top(t)
        top, middle, bottom = t[i], t[j], t[k]
        step = np.float32(plane[9])
        for y in range(int(max(np.ceil(top[1]), 0.0)), int(min(np.floor(bottom[1]), height - 1.0)) + 1):
            xa = along(top, bottom, y)
            xb = along(top, middle, y) if y < middle[1] else along(middle, bottom, y)
            x0 = int(max(np.ceil(min(xa, xb)), 0.0))
            x1 = int(min(np.floor(max(xa, xb)), width - 1.0))
            if x1 < x0:
                continue
            extent[y, 0], extent[y, 1] = min(extent[y, 0], x0), max(extent[y, 1], x1)
            start = np.float32(plane[9] * x0 + plane[10] * y + plane[11])
            near, face = depth[y, x0 : x1 + 1], ids[y, x0 : x1 + 1]
            for x in range(len(near)):
                z = start + step * ramp[x]
                face[x] = m + 1 if z > near[x] else face[x]
                near[x] = max(z, near[x])
