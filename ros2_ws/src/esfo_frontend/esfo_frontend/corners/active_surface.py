"""The surface of active events: which event each pixel and polarity saw last."""

from __future__ import annotations

import numpy as np

BORDER = 4
"""Pixels along the image edge where the outer circle does not fit: events there are never corners."""

INNER_CIRCLE = np.array(
    [
        [0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1],
        [3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1, 0, 1, 2, 3],
    ]
)
"""Offsets dx and dy of the 16 pixels at radius 3, in order around the circle, (2, 16)."""

OUTER_CIRCLE = np.array(
    [
        [0, 1, 2, 3, 4, 4, 4, 3, 2, 1, 0, -1, -2, -3, -4, -4, -4, -3, -2, -1],
        [4, 4, 3, 2, 1, 0, -1, -2, -3, -4, -4, -4, -3, -2, -1, 0, 1, 2, 3, 4],
    ]
)
"""Offsets dx and dy of the 20 pixels at radius 4, in order around the circle, (2, 20)."""


class ActiveSurface:
    """Surface of active events (SAE) of both polarities, with times replaced by their ranks.

    Corner detectors only compare times. Rank 1 is the first time of the stream and every later one has the next rank:
    ranks compare as the times in ns do, ties included, whatever their unit and however long the stream, and take half
    the memory.

    ranks: (2, height, width) int32, 0 where no event has been: older than all others.
    clock: (2,) int64, the rank and the time in ns of the newest event.
    """

    def __init__(self, width: int, height: int) -> None:
        self.ranks = np.zeros((2, height, width), np.int32)
        self.clock = np.array([0, np.iinfo(np.int64).min], np.int64)

    def make_room(self, events: int) -> None:
        """Make sure that ranks do not run out within the next `events`; numbers those in use anew where they would."""
        if self.clock[0] + events <= np.iinfo(np.int32).max:
            return
        # The newest time may be on no pixel any more, and still tie with the next event; 0 must stay that of no event.
        in_use, new = np.unique(np.append(self.ranks, [0, self.clock[0]]), return_inverse=True)
        self.ranks[:] = new[:-2].reshape(self.ranks.shape)
        self.clock[0] = len(in_use) - 1
