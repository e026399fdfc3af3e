"""Corner events, by the detector of choice."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from esfo_core.events import EventArray
from esfo_frontend.corners.arc_star import ArcStarDetector
from esfo_frontend.corners.efast import EfastDetector
from esfo_frontend.options import CornerOptions


class CornerDetector:
    """Marks corner events; holds the surface of active events, so that a stream may come in any pieces."""

    def __init__(self, width: int, height: int, options: CornerOptions) -> None:
        detector = ArcStarDetector if options.detector == "arc_star" else EfastDetector
        self._detector: EfastDetector | ArcStarDetector = detector(width, height, options)

    def detect(self, events: EventArray) -> NDArray[np.bool_]:
        """Return a mask (N,) of the corner events among `events` (N,), which follow those of earlier calls.

        Events are within the sensor and of polarity 0 or 1. Raises FrontendError when time goes back; the detector is
        of no use afterwards.
        """
        return self._detector.detect(events)
