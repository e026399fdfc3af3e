"""Samples to rows of the sensor: where between two samples the face changes, and the blur along the row.

Where neighbouring samples see different faces, the border between them is computed from the edges themselves, and the
sample on whose side it lies takes its share of the other: edges move smoothly although the grid is coarse (the idea of
geometric post-process anti-aliasing, Persson, GPU Pro 2, 2011).

All that `gather` calls stands in this file: a kernel in the cache is not compiled anew when another file changes.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from esfo_simulation.render.rasterizer import EDGES
from esfo_simulation.render.tessellation import CUT

# Triangles between two samples that a surface is followed through.
_HOPS = 32
# Borders of less contrast stay between the samples; a step of the levels is larger.
_CONTRAST = 1e-6
# So far beyond an edge, in samples, its neighbour is looked for.
_BEYOND = 1e-6


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
def holds(plane, x, y):  # type: ignore[no-untyped-def]
    """Whether (x, y) lies in a triangle."""
    return (
        plane[0] * x + plane[1] * y + plane[2] <= 0.0
        and plane[3] * x + plane[4] * y + plane[5] <= 0.0
        and plane[6] * x + plane[7] * y + plane[8] <= 0.0
    )


@njit(cache=True, nogil=True)
def part_at(planes, parts, start, x, y):  # type: ignore[no-untyped-def]
    """Row of the triangle at (x, y) among parts[0] + 1 to parts[1], looked for from row `start` outwards, 0: none."""
    for away in range(parts[1] - parts[0]):
        if start + away <= parts[1] and holds(planes[start + away], x, y):
            return start + away
        if start - away > parts[0] and holds(planes[start - away], x, y):
            return start - away
    return 0


@njit(cache=True, nogil=True)
def beyond(surfaces, row, edge, x, y):  # type: ignore[no-untyped-def]
    """Row of the triangle that goes on from triangle `row` beyond its edge, at (x, y), 0: none."""
    planes, face_of, parts, neighbours = surfaces
    face, origin = face_of[row], int(planes[row, EDGES + edge])
    if origin >= 0:
        across = neighbours[face, origin]
        if across < 0:
            return 0
        return parts[across, 1] if parts[across, 2] else part_at(planes, parts[across], parts[across, 1], x, y)
    found = part_at(planes, parts[face], row, x, y)
    if origin == CUT:
        for across in neighbours[face]:
            if found == 0 and across >= 0:
                found = part_at(planes, parts[across], parts[across, 1], x, y)
    return found


@njit(cache=True, nogil=True)
def surface_end(surfaces, row, other, step):  # type: ignore[no-untyped-def]
    """Follow the surface that triangle `row` belongs to until it turns away, breaks off or arrives at triangle `other`.

    surfaces: planes (M + 1, 15); face_of (M + 1,), the face of each triangle; parts (F, 3), the first triangle of each
    face, less 1 because row 0 is the background, its last, and 1 where that is the whole face; neighbours (F, 3) of
    each face, -1 for none. step: x, y, dx, dy. Returns the share of the step, the row and edge where it ends (edge -1:
    nowhere), and whether that is at `other`. Triangles that are too small to be sampled are walked through.
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


@njit(cache=True, nogil=True)
def blur_row(fine, taps, split, out):  # type: ignore[no-untyped-def]
    """Blur and halve a row: out[j] = sum_k taps[k] fine[2 j + k].

    fine: (2 W + K - 2,), taps: (K,), out: (W,); split: (2, W + K / 2 - 1 or more), scratch: even and odd samples apart.
    """
    even, odd = split[0], split[1]
    for j in range(len(fine) // 2):
        even[j] = fine[2 * j]
        odd[j] = fine[2 * j + 1]
    for j in range(len(out)):
        out[j] = np.float32(0.0)
    for k in range(len(taps) // 2):
        a, b = taps[2 * k], taps[2 * k + 1]
        e, o = even[k:], odd[k:]
        for j in range(len(out)):
            out[j] += a * e[j] + b * o[j]


@njit(cache=True, nogil=True)
def fill(row, value):  # type: ignore[no-untyped-def]
    """Set all of a row: several times as fast as an assignment to a slice."""
    for x in range(len(row)):
        row[x] = value


@njit(cache=True, nogil=True)
def widened(extent, width):  # type: ignore[no-untyped-def]
    """Return extent (H, 2) with one column more on each side, which a border may reach, and one empty row more."""
    out = np.empty((len(extent) + 1, 2), np.int64)
    for y in range(len(extent)):
        drawn = extent[y, 1] >= 0
        out[y, 0] = max(extent[y, 0] - 1, 0) if drawn else width
        out[y, 1] = min(extent[y, 1] + 1, width - 1) if drawn else -1
    out[-1, 0], out[-1, 1] = width, -1
    return out


@njit(cache=True, nogil=True)
def gather(samples, surfaces, shade, taps, rows):  # type: ignore[no-untyped-def]
    """Shade the samples row by row, blur and halve each row.

    samples: ids and depth (H, W) and extent (H, 2) as the rasteriser leaves them. surfaces: as in surface_end; shade:
    radiance by row of ids, row 0 the background. rows: (H, w), receives the result where it may differ from the
    background. Leaves ids and depth zero, and in extent the first and last column that was written to `rows`.
    """
    ids, depth, extent = samples
    height, width = ids.shape
    touched = np.flatnonzero(extent[:, 1] >= 0)
    if len(touched) == 0:
        return
    top, bottom = max(touched[0] - 1, 0), min(touched[-1] + 1, height - 1)
    # Row -1 of columns is the empty one, too.
    columns = widened(extent, width)
    plain, sharp = np.full((2, width), shade[0]), np.full((2, width), shade[0])
    split = np.empty((2, width // 2), np.float32)
    shade_row(top, ids, surfaces, shade, columns[top], plain[0])
    sharp[0] = plain[0]
    for y in range(top, bottom + 1):
        above, here, below = columns[y - 1], columns[y], columns[y + 1]
        if y < bottom:
            fill(plain[1], shade[0])
            shade_row(y + 1, ids, surfaces, shade, below, plain[1])
            sharp[1] = plain[1]
            both = (min(here[0], below[0]), max(here[1], below[1]))
            place_flat_borders(y, ids, surfaces, shade, both, (plain, sharp))
        first, last = min(above[0], here[0], below[0]), max(above[1], here[1], below[1])
        j0, j1 = max((first - len(taps) + 2) // 2, 0), min(last // 2, rows.shape[1] - 1)
        blur_row(sharp[0, 2 * j0 : 2 * j1 + len(taps)], taps, split, rows[y, j0 : j1 + 1])
        fill(ids[y, first : last + 1], 0)
        fill(depth[y, first : last + 1], np.float32(0.0))
        extent[y, 0], extent[y, 1] = j0, j1
        plain[0], sharp[0] = plain[1], sharp[1]
