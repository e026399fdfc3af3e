"""Parametrization of the orbit in its minimal gauge.

Motion has four observable parameters with known intrinsics. They are held as a rotation ``Q = [u v n]`` (three) and
the rate f (one). The gauge: orbit radius 1, world origin at the foot of the camera's perpendicular on the axis, object
coordinates y in the axes of Q at the reference time. Then, with ``theta = 2 pi f (t - t_ref)``,

    X_camera(t) = Q (Rz(-theta) y - e_x)

which is the paper's orbiting camera (equation 1) seen from the camera, exact for any time t.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esfo_backend.errors import BackendError
from esfo_core.events import NS_PER_S
from esfo_core.orbit import Matrix, Spin, Vector


@dataclass(frozen=True)
class Motion:
    """The four motion parameters: Q (3, 3) = [u v n] and rate in Hz (positive)."""

    Q: Matrix
    rate_hz: float

    @property
    def axis(self) -> Vector:
        """Spin axis in the camera frame, (3,)."""
        return -self.Q[:, 2]


def motion_from_axis(axis: Vector, towards: Vector, rate_hz: float) -> Motion:
    """Return the motion about `axis` (3,) of an object seen in the direction `towards` (3,).

    Raises BackendError when the axis passes through the camera.
    """
    perpendicular = towards - (towards @ axis) * axis
    length = np.linalg.norm(perpendicular)
    if length < 1e-9:
        raise BackendError(f"axis {axis.tolist()} passes through the camera")
    u, n = -perpendicular / length, -axis
    return Motion(np.stack([u, np.cross(n, u), n], axis=1), rate_hz)


def spin_and_points(motion: Motion, y: Matrix, t_ref: int, t0: int) -> tuple[Spin, Matrix]:
    """Leave the gauge: return the spin, its centre on the axis at the median height, and (P, 3) points at t0."""
    theta = 2 * np.pi * motion.rate_hz * (t0 - t_ref) / NS_PER_S
    c, s = np.cos(theta), np.sin(theta)
    rotated = np.stack([c * y[:, 0] + s * y[:, 1], -s * y[:, 0] + c * y[:, 1], y[:, 2]], axis=1)
    height = float(np.median(y[:, 2])) if len(y) else 0.0
    center = motion.Q @ np.array([-1.0, 0.0, height])
    return Spin(motion.axis, motion.rate_hz, center, t0), (rotated - [0.0, 0.0, height]) @ motion.Q.T
