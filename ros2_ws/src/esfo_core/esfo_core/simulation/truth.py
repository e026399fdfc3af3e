"""What a simulated recording is known to show."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from esfo_core.orbit import Spin


@dataclass(frozen=True)
class Truth:
    """Motion of the object, metres, with t0 the time of the first event; and how it was made."""

    spin: Spin
    revolutions: float
    object: str
    view: str
    seed: int
    events: int

    def to_json(self) -> dict[str, Any]:
        """Return the content of `truth.json`: the names are those of `orbit.json`."""
        orbit = self.spin.paper_orbit()
        return {
            "object": self.object,
            "view": self.view,
            "seed": self.seed,
            "events": self.events,
            "revolutions": self.revolutions,
            "spin_rate_hz": self.spin.rate_hz,
            "axis": self.spin.axis.tolist(),
            "center": self.spin.center.tolist(),
            "t0_ns": self.spin.t0,
            "scale": "metric",
            "radius": orbit.radius,
            "orbit": {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in orbit.parameters().items()},
        }

    def write_json(self, path: Path) -> None:
        """Write `truth.json`."""
        path.write_text(json.dumps(self.to_json(), indent=2) + "\n")
