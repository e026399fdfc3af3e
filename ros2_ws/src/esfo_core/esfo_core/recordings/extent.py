"""The sensor size that events need, where nothing tells it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from esfo_core.errors import RecordingError

LARGEST_SENSOR = 8192
"""Pixels; the largest event sensors have 1280 columns."""

LARGEST_ASPECT = 16

STRAY_SHARE = 1e-3
"""Largest share of the events, or one of them, that may be stray: at more than twice the pixel of all the others."""


class Extent:
    """Counts the pixels of events, and finds the size that holds them but for a few stray ones."""

    def __init__(self) -> None:
        self._counts = np.zeros((2, 1 << 16), np.int64)

    def add(self, x: NDArray[np.integer], y: NDArray[np.integer]) -> None:
        """Take in columns x and rows y, 0 to 65535, of any numbers of events."""
        for counts, values in zip(self._counts, (x, y), strict=True):
            found = np.bincount(values)
            counts[: len(found)] += found

    def size(self) -> tuple[int, int]:
        """Return width and height in pixels.

        Raises RecordingError without an event, and for a size that no sensor has.
        """
        if not self._counts.any():
            raise RecordingError("no event tells the sensor size")
        width, height = (_highest(counts) + 1 for counts in self._counts)
        if max(width, height) > LARGEST_SENSOR or max(width, height) > LARGEST_ASPECT * min(width, height):
            raise RecordingError(
                f"the events need a sensor of {width}x{height} px, which none has: the columns x and y may be others "
                "(option columns), or the size is to be told (options width and height)"
            )
        return width, height


def _highest(counts: NDArray[np.int64]) -> int:
    """Highest pixel but for stray ones, from the number of events of each."""
    used = np.flatnonzero(counts)
    total = np.cumsum(counts[used])
    stray = total[-1] - total <= max(1, STRAY_SHARE * total[-1])
    far = np.append(used[1:] > 2 * (used[:-1] + 1), True)  # from here to the next one up
    return int(used[np.argmax(stray & far)])
