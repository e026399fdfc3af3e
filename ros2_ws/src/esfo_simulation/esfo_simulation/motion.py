"""Motion of a rigid body before the camera: a spin about a fixed axis, and departures from it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from esfo_core.errors import SimulationError
from esfo_core.events import NS_PER_S
from esfo_core.orbit import Matrix, Spin, Vector, object_frame, rotation


class RigidMotion(Protocol):
    """A rigid motion from the coordinates of a model to the camera's optical frame."""

    def pose(self, t: float) -> tuple[Matrix, Vector]:
        """Return R (3, 3) and T (3,), metres, at `t` ns: the model's point X is at R X + T."""


@dataclass(frozen=True)
class BodyMotion:
    """A body that spins, and may change its rate, nutate and drift away.

    spin: axis, rate and centre at t0. With `nutation_rad` 0 the axis is fixed in the body as well.
    slope_hz_s: change of the rate, Hz per second.
    nutation_rad: angle between the body's axis of symmetry and `spin.axis`, which then is the direction of its angular
    momentum; spin.rate_hz is the rate at which the body's axis goes round it (the precession).
    inertia_ratio: moment of inertia about the axis of symmetry over that across it, which sets how fast the body turns
    about its own axis: a free symmetric top (Goldstein, Classical Mechanics, section 5.6).
    velocity: (3,) m/s of the centre.
    """

    spin: Spin
    slope_hz_s: float = 0.0
    nutation_rad: float = 0.0
    inertia_ratio: float = 1.0
    velocity: Vector = field(default_factory=lambda: np.zeros(3))

    @property
    def kind(self) -> str:
        """One of `fixed_axis`, `drifting_rate`, `nutating`, `translating`: what most upsets a fixed-axis estimate."""
        if self.velocity.any():
            return "translating"
        if self.nutation_rad:
            return "nutating"
        return "drifting_rate" if self.slope_hz_s else "fixed_axis"

    @property
    def repeats(self) -> bool:
        """Whether every turn passes through the same poses, at whatever rate."""
        return not self.velocity.any() and not self.nutation_rad and self.spin.rate_hz > 0

    def turns(self, t: NDArray[np.float64]) -> Vector:
        """Turns since t0 at the times `t` (N,) in ns."""
        s = (t - self.spin.t0) / NS_PER_S
        return np.asarray(s * (self.spin.rate_hz + 0.5 * self.slope_hz_s * s))

    def rate_hz(self, t: NDArray[np.float64]) -> Vector:
        """Rate in Hz at the times `t` (N,) in ns."""
        return np.asarray(self.spin.rate_hz + self.slope_hz_s * (t - self.spin.t0) / NS_PER_S)

    def time_of(self, turns: NDArray[np.float64]) -> Vector:
        """Return the times (N,) in ns at which so many turns (N,) are done.

        Raises SimulationError when the rate falls to nothing before.
        """
        rate = self.spin.rate_hz
        under_root = rate * rate + 2 * self.slope_hz_s * turns
        if (under_root <= 0).any():
            most = rate * rate / (-2 * self.slope_hz_s)
            raise SimulationError(f"a rate that falls by {-self.slope_hz_s} Hz/s ends after {most:.3f} turns")
        # The root of the smaller magnitude, in the form that does not cancel as the slope goes to 0.
        return np.asarray(self.spin.t0 + NS_PER_S * 2 * turns / (rate + np.sqrt(under_root)))

    def pose(self, t: float) -> tuple[Matrix, Vector]:
        """As `RigidMotion.pose`."""
        angle = 2 * np.pi * float(self.turns(np.array(t)))
        R = rotation(self.spin.axis, angle)
        if self.nutation_rad:
            tilt = rotation(object_frame(self.spin.axis)[:, 0], self.nutation_rad)
            own = (1 / self.inertia_ratio - 1) * np.cos(self.nutation_rad) * angle
            R = R @ tilt @ rotation(self.spin.axis, own)
        return R, self.spin.center + self.velocity * ((t - self.spin.t0) / NS_PER_S)
