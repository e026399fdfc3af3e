"""Triangles to samples: which face is nearest at every point of a grid, and where between two points the face changes.

The depth buffer finds the faces. Where neighbouring samples see different ones, the border between them is computed
from the edges themselves, and the sample on whose side it lies takes its share of the other: edges move smoothly
although the grid is coarse (the idea of geometric post-process anti-aliasing, Persson, GPU Pro 2, 2011).
"""

from __future__ import annotations

import numpy as np
from numba import njit

# Columns of a plane: three edges a, b, c with a x + b y + c <= 0 inside, then 1/z as the same kind of sum.
PLANE = 12
# A triangle of less area, in samples, almost never has one; its slopes are only rounding errors.
_SMALLEST = 1e-6
# Triangles between two samples that a surface is followed through.
_HOPS = 32
# Borders of less contrast stay between the samples; a step of the levels is larger.
_CONTRAST = 1e-6
# So far beyond an edge, in samples, its neighbour is looked for.
_BEYOND = 1e-6


@njit(cache=True, nogil=True)
def set_plane(t, plane):  # type: ignore[no-untyped-def]
    """Edges and depth of the triangle t (3, 3) of u, v, 1/z into plane (12,); False if not to be drawn."""
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
        gx += a * (t[k, 2] - t[0, 2]) / area
        gy += b * (t[k, 2] - t[0, 2]) / area
    plane[9], plane[10], plane[11] = gx, gy, t[0, 2] - gx * t[0, 0] - gy * t[0, 1]
    return area < -_SMALLEST


@njit(cache=True, nogil=True)
def from_top(t):  # type: ignore[no-untyped-def]
    """Indices of the corners of t (3, 3) by v, then u: every edge is walked alike, whichever face it belongs to."""
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

    corners: (M, 3, 3) u, v of the grid, whose samples are the integers, and 1/z, which is linear over the image of a
    plane. Changed in place: planes (M + 1, 12), where triangle m that is drawn sets row m + 1; ids (H, W), the row of
    the triangle, 0 where there is none; depth (H, W), 1/z; extent (H, 2), first and last column that was drawn to.
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


@njit(cache=True, nogil=True)
def way_out(plane, step):  # type: ignore[no-untyped-def]
    """Return how many steps x, y, dx, dy lead out of a triangle, 2 at most, and through which edge (-1: none)."""
    x, y, dx, dy = step
    steps, edge = 2.0, -1
    for k in range(3):
        a, b = plane[3 * k], plane[3 * k + 1]
        slope = a * dx + b * dy
        if slope > 0.0:
            value = a * x + b * y + plane[3 * k + 2]
            if -value < steps * slope:
                steps, edge = -value / slope, k
    return max(steps, 0.0), edge


@njit(cache=True, nogil=True)
def part_at(planes, parts, x, y):  # type: ignore[no-untyped-def]
    """Row of the triangle at (x, y) among those after parts[0] and up to parts[1], 0: none."""
    for row in range(parts[0] + 1, parts[1] + 1):
        e = planes[row]
        if (
            e[0] * x + e[1] * y + e[2] <= 0.0
            and e[3] * x + e[4] * y + e[5] <= 0.0
            and e[6] * x + e[7] * y + e[8] <= 0.0
        ):
            return row
    return 0


@njit(cache=True, nogil=True)
def beyond(surfaces, row, edge, x, y):  # type: ignore[no-untyped-def]
    """Row of the triangle that goes on from triangle `row` beyond its edge, at (x, y), 0: none."""
    planes, face_of, parts, neighbours = surfaces
    face = face_of[row]
    if parts[face, 1] - parts[face, 0] == 1:
        across = neighbours[face, edge]
        if across < 0 or parts[across, 1] == parts[across, 0]:
            return 0
        if parts[across, 1] - parts[across, 0] == 1:
            return parts[across, 1]
        return part_at(planes, parts[across], x, y)
    found = part_at(planes, parts[face], x, y)
    for across in neighbours[face]:
        if found == 0 and across >= 0:
            found = part_at(planes, parts[across], x, y)
    return found


@njit(cache=True, nogil=True)
def surface_end(surfaces, row, other, step):  # type: ignore[no-untyped-def]
    """Follow the surface that triangle `row` belongs to until it turns away, breaks off or arrives at triangle `other`.

    surfaces: planes (M + 1, 12); face_of (M + 1,), the face of each triangle; parts (F, 2), the first triangle of each
    face, less 1 because row 0 is the background, and its last; neighbours (F, 3) of each face, -1 for none. step: x, y,
    dx, dy. Returns the share of the step, the row and edge where it ends (edge -1: nowhere), and whether that is at
    `other`. Triangles that are too small to be sampled are walked through.
    """
    planes = surfaces[0]
    x, y, dx, dy = step
    steps, edge = way_out(planes[row], step)
    for _ in range(_HOPS):
        if edge < 0 or steps >= 1.0:
            break
        following = beyond(surfaces, row, edge, x + (steps + _BEYOND) * dx, y + (steps + _BEYOND) * dy)
        if following == 0:
            break
        if following == other:
            return steps, row, edge, True
        further, way = way_out(planes[following], step)
        if way < 0 or further < steps:
            break
        row, steps, edge = following, further, way
    return steps, row, edge, False


@njit(cache=True, nogil=True)
def border(surfaces, p, q, step):  # type: ignore[no-untyped-def]
    """Where between two samples, of which the first sees triangle p and the second q, p ends.

    surfaces, step: as in surface_end. Returns the share of the step, and the normal of the border. Both surfaces go on
    behind each other until they end; what is nearer hides the other. Where both end before they meet, something too
    thin to be sampled lies between: the middle is taken.
    """
    planes = surfaces[0]
    x, y, dx, dy = step
    p_ends, p_row, p_edge, meet = surface_end(surfaces, p, q, step)
    if meet:
        return p_ends, planes[p_row, 3 * p_edge], planes[p_row, 3 * p_edge + 1]
    q_ends, q_row, q_edge, _ = surface_end(surfaces, q, p, (x + dx, y + dy, -dx, -dy))
    low, high = max(1.0 - q_ends, 0.0), min(p_ends, 1.0)
    gx, gy = planes[p, 9] - planes[q, 9], planes[p, 10] - planes[q, 10]
    at_start = gx * x + gy * y + planes[p, 11] - planes[q, 11]
    slope = gx * dx + gy * dy
    nearer_low, nearer_high = at_start + slope * low, at_start + slope * high
    if low >= high:
        share, row, edge = 0.5 * (low + high), p_row, p_edge
    elif nearer_low >= 0.0 and nearer_high >= 0.0:
        share, row, edge = high, p_row, p_edge
    elif nearer_low <= 0.0 and nearer_high <= 0.0:
        share, row, edge = low, q_row, q_edge
    else:
        return -at_start / slope, gx, gy
    if edge < 0:
        return share, float(dx), float(dy)
    return share, planes[row, 3 * edge], planes[row, 3 * edge + 1]


@njit(cache=True, nogil=True)
def shade_row(y, ids, surfaces, shade, columns, out):  # type: ignore[no-untyped-def]
    """Radiance of the samples of row y, with the steep borders between them in place.

    surfaces: as in surface_end; shade: (M + 1,) radiance by row of ids. columns: first and last to set in out (W,).
    """
    face, radiance = ids[y, columns[0] : columns[1] + 1], out[columns[0] : columns[1] + 1]
    for x in range(len(face)):
        radiance[x] = shade[face[x]]
    for x in range(len(face) - 1):
        p, q = face[x], face[x + 1]
        if p != q and abs(shade[p] - shade[q]) > _CONTRAST * shade[p]:
            share, a, b = border(surfaces, p, q, (float(x + columns[0]), float(y), 1.0, 0.0))
            if abs(a) >= abs(b):
                radiance[x + (share > 0.5)] += np.float32(share - 0.5) * (shade[p] - shade[q])


@njit(cache=True, nogil=True)
def place_flat_borders(y, ids, surfaces, shade, columns, rows):  # type: ignore[no-untyped-def]
    """Put the borders between the rows y and y + 1 that are more flat than steep into place.

    surfaces, shade, columns: as above. rows: radiance of the two without such borders, (2, W), and the same to change.
    """
    plain, out = rows
    upper, lower = ids[y, columns[0] : columns[1] + 1], ids[y + 1, columns[0] : columns[1] + 1]
    for i in range(len(upper)):
        p, q = upper[i], lower[i]
        if p != q and abs(shade[p] - shade[q]) > _CONTRAST * shade[p]:
            x = i + columns[0]
            share, a, b = border(surfaces, p, q, (float(x), float(y), 0.0, 1.0))
            if abs(b) > abs(a):
                out[1 if share > 0.5 else 0, x] += np.float32(share - 0.5) * (plain[0, x] - plain[1, x])
