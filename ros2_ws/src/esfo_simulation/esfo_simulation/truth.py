"""The truth of a simulated recording."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from esfo_core.orbit import Spin
from esfo_simulation.motion import BodyMotion

_HISTORY = 101


@dataclass(frozen=True)
class Truth:
    """Motion of the object, metres, and how it was made.

    motion: from the first frame on. span: times of the first and of the last event, ns. events: their number; lost: how
    many others the read-out of the sensor lost. options: of the scene, by their dotted names. The camera-aligned object
    coordinates of `spin` are those of the first event.
    """

    motion: BodyMotion
    span: tuple[int, int]
    events: int
    lost: int
    options: Mapping[str, bool | int | float | str]

    @property
    def spin(self) -> Spin:
        """Axis, rate and centre at the first event."""
        at_first = self.motion.pose(float(self.span[0]))[1]
        rate = float(self.motion.rate_hz(np.array(self.span[0], np.float64)))
        return Spin(self.motion.spin.axis, rate, at_first, self.span[0])

    def to_json(self) -> dict[str, Any]:
        """Return the content of `truth.json`: the names are those of `orbit.json`.

        An object that does not spin has no `orbit`, and a null `radius`.
        """
        motion, spin = self.motion, self.spin
        orbit = spin.paper_orbit() if spin.rate_hz else None
        parameters = orbit.parameters() if orbit else {}
        turns = motion.turns(np.array(self.span, np.float64))
        return {
            **{name: self.options[name] for name in ("object", "mesh", "view", "seed")},
            "events": self.events,
            "events_lost": self.lost,
            "revolutions": float(turns[1] - turns[0]),
            "spin_rate_hz": spin.rate_hz,
            "axis": spin.axis.tolist(),
            "center": spin.center.tolist(),
            "t0_ns": spin.t0,
            "scale": "metric",
            "radius": orbit.radius if orbit else None,
            "orbit": {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in parameters.items()},
            "motion": {
                "kind": motion.kind,
                "rate_slope_hz_s": motion.slope_hz_s,
                "nutation_deg": float(np.degrees(motion.nutation_rad)),
                "inertia_ratio": motion.inertia_ratio,
                "velocity_m_s": motion.velocity.tolist(),
            },
            "history": self._history(),
            "options": dict(self.options),
        }

    def _history(self) -> dict[str, list[float]]:
        """Rate and phase over the recording: the phase is the angle turned since the first event, radians."""
        t = np.linspace(*self.span, _HISTORY).astype(np.int64)
        turns = self.motion.turns(t.astype(np.float64))
        return {
            "t_ns": t.tolist(),
            "rate_hz": self.motion.rate_hz(t.astype(np.float64)).tolist(),
            "phase_rad": (2 * np.pi * (turns - turns[0])).tolist(),
        }

    def write_json(self, path: Path) -> None:
        """Write `truth.json`."""
        path.write_text(json.dumps(self.to_json(), indent=2) + "\n")
