"""Compilation of all kernels before the first live event."""

from __future__ import annotations

import numpy as np

from esfo_core.camera import SensorSize
from esfo_core.events import NS_PER_S, EventArray, make_events
from esfo_frontend.frontend import Frontend
from esfo_frontend.options import FrontendOptions

WIDTH, HEIGHT = 160, 120


def warm_up(options: FrontendOptions) -> None:
    """Run the front-end on a small scene with corners, clusters and tracks: live packets then need no compilation."""
    frontend = Frontend(SensorSize(WIDTH, HEIGHT), options)
    frontend.process(drifting_squares(duration_s=0.3))
    frontend.flush()


def drifting_squares(duration_s: float) -> EventArray:
    """Return the events of bright squares that drift over a dark ground: one where each edge passes each pixel."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    half, speed = 12.0, (150.0, 90.0)
    parts = []
    for cx, cy in ((20, 20), (80, 30), (40, 70)):
        # Inside while |x - cx - vx t| <= half, and likewise for y.
        enter = np.maximum((x - cx - half) / speed[0], (y - cy - half) / speed[1])
        leave = np.minimum((x - cx + half) / speed[0], (y - cy + half) / speed[1])
        for polarity, t in ((1, enter), (0, leave)):
            seen = (enter < leave) & (t > 0) & (t < duration_s)
            parts.append(make_events(x[seen], y[seen], np.full(seen.sum(), polarity), np.rint(t[seen] * NS_PER_S)))
    events = np.concatenate(parts)
    return events[np.argsort(events["t"], kind="stable")]
