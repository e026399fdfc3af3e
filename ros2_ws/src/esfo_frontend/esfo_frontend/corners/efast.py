"""eFAST corners on the surface of active events (Mueggler, Bartolozzi, Scaramuzza, BMVC 2017), by the far-pair mask.

An arc of at most `d` ring pixels that is newer than the rest of the ring cannot hold both pixels of a pair that is `d`
or more apart. So with M = max over such pairs of min(v_i, v_j), every allowed arc lies within {v > M}: one bit mask
that takes no branch, and shows for nearly every ring at once whether there is an arc.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from esfo_core.events import EventArray
from esfo_frontend.corners.active_surface import BORDER, INNER_CIRCLE, OUTER_CIRCLE, ActiveSurface
from esfo_frontend.errors import FrontendError
from esfo_frontend.options import CornerOptions

FAR_INNER, FAR_OUTER = 6, 8
"""Distances from which on two pixels of the inner and of the outer circle are a far pair: the longest usual arcs."""

_FEW = 20_000
"""Events that one thread is done with before a second one has begun."""

_NONE = -1


class EfastDetector:
    """Marks eFAST corners: on both circles the newest pixels form one arc of allowed length.

    Every time on the arc is later than every time off it. Each polarity has a surface of its own, so that two threads
    can take one each and still find the same corners.
    """

    def __init__(self, width: int, height: int, options: CornerOptions) -> None:
        self._surface = ActiveSurface(width, height)
        self._detect = _detection(
            (options.shortest_inner, options.longest_inner, options.shortest_outer, options.longest_outer)
        )
        self._pool = ThreadPoolExecutor(2) if options.threads == 2 else None

    def detect(self, events: EventArray) -> NDArray[np.bool_]:
        """Return a mask (N,) of the corner events among `events` (N,), which follow those of earlier calls.

        Raises FrontendError when time goes back; the detector is of no use afterwards.
        """
        self._surface.make_room(len(events))
        corner = np.zeros(len(events), np.bool_)
        work = partial(self._detect, events, self._surface.ranks, corner)
        clock = self._surface.clock
        if self._pool is None or len(events) < _FEW:
            back = work(clock, _NONE)
        else:
            other = self._pool.submit(work, clock.copy(), 1)
            back = work(clock, 0)
            other.result()
        if back >= 0:
            raise FrontendError(f"time goes back at {events['t'][back]} ns: events are not sorted")
        return corner


def _far_pair_mask(circle: NDArray[np.int64], far: int) -> Callable[..., Any]:
    """Return an intrinsic (surface, at, width) -> int64 whose bit i is set where ring pixel i is newer than M.

    surface: flat (2 * height * width,) int32; `at`: index of the centre. The ring is held in one LLVM vector, which is
    two to three times faster than what the compiler makes of loops over an array.
    """
    n = circle.shape[1]
    value, index = ir.IntType(32), ir.IntType(64)
    ring_type = ir.VectorType(value, n)

    def turned(builder: Any, ring: Any, by: int) -> Any:
        return builder.shuffle_vector(ring, ring, ir.Constant(ring_type, [(i + by) % n for i in range(n)]))

    def read_ring(builder: Any, data: Any, at: Any, width: Any) -> Any:
        ring = ir.Constant(ring_type, ir.Undefined)
        for i, (dx, dy) in enumerate(circle.T.tolist()):
            row = builder.add(at, builder.mul(width, index(dy)))
            pixel = builder.load(builder.gep(data, [builder.add(row, index(dx))]))
            ring = builder.insert_element(ring, pixel, value(i))
        return ring

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        surface, at, width = arguments
        ring = read_ring(builder, context.make_array(signature.args[0])(context, builder, surface).data, at, width)
        partner = turned(builder, ring, far)
        for distance in range(far + 1, n // 2 + 1):
            other = turned(builder, ring, distance)
            partner = builder.select(builder.icmp_signed(">", partner, other), partner, other)
        smaller = builder.select(builder.icmp_signed("<", ring, partner), ring, partner)
        largest = cgutils.get_or_insert_function(  # type: ignore[no-untyped-call]
            builder.module, ir.FunctionType(value, [ring_type]), f"llvm.vector.reduce.smax.v{n}i32"
        )
        bound = builder.insert_element(ir.Constant(ring_type, ir.Undefined), builder.call(largest, [smaller]), value(0))
        bound = builder.shuffle_vector(bound, bound, ir.Constant(ring_type, [0] * n))
        return builder.zext(builder.bitcast(builder.icmp_signed(">", ring, bound), ir.IntType(n)), index)

    def mask(_: Any, surface: Any, at: Any, width: Any) -> Any:
        return types.int64(surface, types.int64, types.int64), generate

    return intrinsic(mask)


# In the file of their callers: numba's cache notices changes only there.
_inner_mask = _far_pair_mask(INNER_CIRCLE, FAR_INNER)
_outer_mask = _far_pair_mask(OUTER_CIRCLE, FAR_OUTER)


@njit(cache=True, nogil=True)
def _turned(mask, size):  # type: ignore[no-untyped-def]
    """Return the bits of a ring of `size` pixels moved by one; a bit beyond the ring may be set."""
    return (mask << 1) | (mask >> (size - 1))


@njit(cache=True, nogil=True, inline="always")  # a call here, though rare, makes all of it a fifth slower
def _without_oldest(mask, surface, at, circle, size):  # type: ignore[no-untyped-def]
    """Return `mask` without the oldest of its pixels, all of them when several are."""
    oldest = np.int32(np.iinfo(np.int32).max)
    for i in range(size):
        if (mask >> i) & 1 and surface[at + circle[i]] < oldest:
            oldest = surface[at + circle[i]]
    for i in range(size):
        if surface[at + circle[i]] == oldest:
            mask &= ~(1 << i)
    return mask


@njit(cache=True, nogil=True)
def _has_arc(mask, surface, at, circle, lengths):  # type: ignore[no-untyped-def]
    """Return whether an arc of allowed length, newer than the rest of the ring, lies within the bits of `mask`.

    mask: pixels newer than all others; circle: (n,) offsets of the ring's pixels from `at` in the flat `surface`;
    lengths: n, shortest and longest arc. When the mask itself is no such arc, its oldest pixels are in none.
    """
    size, shortest, longest = lengths
    while True:
        run = mask
        for _ in range(shortest - 1):
            run &= _turned(run, size)
        if run == 0:
            return False
        begins = mask & ~_turned(mask, size)
        if begins != 0 and begins & (begins - 1) == 0:
            run = mask
            for _ in range(longest):
                run &= _turned(run, size)
            if run == 0:
                return True
        mask = _without_oldest(mask, surface, at, circle, size)


@cache
def _detection(lengths: tuple[int, int, int, int]) -> Callable[..., int]:
    """Return the kernel for these lengths of arcs: as constants they make it a fifth faster."""
    shortest_inner, longest_inner, shortest_outer, longest_outer = lengths

    @njit(cache=True, nogil=True)
    def detect(events, ranks, corner, clock, skipped):  # type: ignore[no-untyped-def]
        """Write the events into `ranks` (2, height, width) one by one and mark corners in `corner` (N,).

        Those of polarity `skipped` only pass their time on. Returns the index of an event earlier than the one before
        it, where the work has stopped, or -1.
        """
        height, width = ranks.shape[1:]
        surface = ranks.reshape(-1)
        inner, outer = INNER_CIRCLE[1] * width + INNER_CIRCLE[0], OUTER_CIRCLE[1] * width + OUTER_CIRCLE[0]
        rank, last = clock
        for i in range(len(events)):
            event = events[i]
            if event.t != last:
                if event.t < last:
                    return i
                rank += 1
                last = event.t
            if event.p == skipped:
                continue
            x, y = np.int64(event.x), np.int64(event.y)
            at = (np.int64(event.p) * height + y) * width + x
            surface[at] = rank
            if x < BORDER or x >= width - BORDER or y < BORDER or y >= height - BORDER:
                continue
            mask = _inner_mask(surface, at, width) if longest_inner <= FAR_INNER else (1 << 16) - 1
            if not _has_arc(mask, surface, at, inner, (16, shortest_inner, longest_inner)):
                continue
            mask = _outer_mask(surface, at, width) if longest_outer <= FAR_OUTER else (1 << 20) - 1
            corner[i] = _has_arc(mask, surface, at, outer, (20, shortest_outer, longest_outer))
        clock[0], clock[1] = rank, last
        return -1

    return detect
