"""Corner events with a label each: the cluster that a corner belongs to or, with association, the track."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from esfo_core.events import EventArray, empty_events

NO_LABEL = -1
"""Label of corners in no cluster (noise) or of no track."""


@dataclass(frozen=True)
class LabelledCorners:
    """Corners in order of time.

    x, y: (N,) uint16 px. polarity: (N,) uint8, 0 off, 1 on. t: (N,) int64 ns. label: (N,) int32, id of the cluster from
    the paper's stages, of the track from association; NO_LABEL for none.
    """

    x: NDArray[np.uint16]
    y: NDArray[np.uint16]
    polarity: NDArray[np.uint8]
    t: NDArray[np.int64]
    label: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.t)

    @staticmethod
    def from_events(corners: EventArray, label: NDArray[np.integer]) -> LabelledCorners:
        """Build from corner events (N,) and their labels (N,)."""
        return LabelledCorners(
            np.ascontiguousarray(corners["x"]),
            np.ascontiguousarray(corners["y"]),
            corners["p"].astype(np.uint8),
            np.ascontiguousarray(corners["t"]),
            label.astype(np.int32),
        )

    @staticmethod
    def concatenate(parts: list[LabelledCorners]) -> LabelledCorners:
        """Stack the columns of several tables in the order given."""
        parts = [LabelledCorners.from_events(empty_events(), np.empty(0, np.int32)), *parts]
        return LabelledCorners(
            np.concatenate([p.x for p in parts]),
            np.concatenate([p.y for p in parts]),
            np.concatenate([p.polarity for p in parts]),
            np.concatenate([p.t for p in parts]),
            np.concatenate([p.label for p in parts]),
        )
