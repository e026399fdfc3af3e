"""A clean moving scene: bright squares on a dark ground, one event for each pixel that an edge passes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from esfo_core.events import EventArray, make_events


@dataclass(frozen=True)
class Scene:
    """Events of squares in straight motion, with the truth.

    corner0: (C, 2) px, the squares' corners at t = 0; velocity: (C, 2) px/s.
    """

    width: int
    height: int
    events: EventArray
    corner0: NDArray[np.float64]
    velocity: NDArray[np.float64]

    def corners_at(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return (N, C, 2): where the corners are at the times (N,)."""
        return self.corner0 + (t_ns / 1e9)[:, None, None] * self.velocity


def moving_squares(
    size: tuple[int, int],
    squares: list[tuple[float, float, float, float]],
    velocity: list[tuple[float, float]],
    duration: float,
) -> Scene:
    """Squares (centre x and y, edge, turned by degrees) in px with velocities in px/s, watched for `duration` s."""
    width, height = size
    y, x = np.mgrid[:height, :width]
    parts, corners, speeds = [], [], []
    for (cx, cy, edge, degrees), v in zip(squares, velocity, strict=True):
        enter, leave = np.zeros((height, width)), np.full((height, width), np.inf)
        for angle in np.radians(degrees + np.array([0, 90, 180, 270])):
            normal = np.array([np.cos(angle), np.sin(angle)])
            speed = normal @ v
            # The pixel is inside of this edge while outside - speed * t <= 0.
            outside = normal[0] * (x - cx) + normal[1] * (y - cy) - edge / 2
            if speed > 0:
                enter = np.maximum(enter, outside / speed)
            else:
                leave = np.minimum(leave, outside / speed)
            diagonal = angle + np.pi / 4
            corners.append((cx + edge / 2**0.5 * np.cos(diagonal), cy + edge / 2**0.5 * np.sin(diagonal)))
            speeds.append(v)
        for polarity, t in ((1, enter), (0, leave)):
            seen = (enter < leave) & (t > 0) & (t < duration)
            parts.append(make_events(x[seen], y[seen], np.full(seen.sum(), polarity), np.rint(t[seen] * 1e9)))
    events = np.concatenate(parts)
    events = events[np.argsort(events["t"], kind="stable")]
    return Scene(width, height, events, np.array(corners), np.array(speeds))


@pytest.fixture(scope="session")
def scene() -> Scene:
    """Two squares that pass each other, 0.5 s, about 17,000 events."""
    return moving_squares((200, 150), [(35, 30, 30, 20), (150, 98, 34, 30)], [(210.0, 11.0), (-190.0, 15.0)], 0.5)
