"""Geometry of an orbit: the spinning object before a static camera, and the orbiting camera of the paper.

Both describe the same motion. With the unit spin axis `a` (camera frame) and a point `p` of the axis, an object
point X moves as ``X_cam(t) = Exp(2 pi f (t - t0) a) X + p``. The paper (section 3, equation 1) lets the camera move:
``C(t) = c + r cos(2 pi f t) u + r sin(2 pi f t) v`` with ``v = n x u``. The two agree for ``n = -a``,
``c = -(p . a) a``, ``r = |p_perp|``, ``u = -p_perp / r`` where ``p_perp = p - (p . a) a``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from esfo_core.camera import Camera
from esfo_core.errors import EsfoError
from esfo_core.events import NS_PER_S

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


class OrbitError(EsfoError):
    """An orbit is impossible or undefined."""


def rotation(axis: Vector, angle: float) -> Matrix:
    """Rodrigues' formula: the (3, 3) rotation by `angle` radians about the unit vector `axis` (3,)."""
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K))


@dataclass(frozen=True)
class PaperOrbit:
    """The 14 parameters of the paper (section 3): r, f, R0, n, u and c.

    World frame: the camera frame at the first event, moved so that its origin is the centre point `p`.
    radius: orbit radius. rate_hz: f. R0: (3, 3), from the look-at frame to the camera. normal, u, c: (3,).
    """

    radius: float
    rate_hz: float
    R0: Matrix
    normal: Vector
    u: Vector
    c: Vector

    def parameters(self) -> dict[str, float | Vector | Matrix]:
        """Return the 14 parameters by the names that they have in `orbit.json` and `truth.json`."""
        return {"r": self.radius, "f": self.rate_hz, "R0": self.R0, "n": self.normal, "u": self.u, "c": self.c}

    def camera_center(self, t: float) -> Vector:
        """Return C(t), (3,), at `t` seconds after the first event (equation 1)."""
        v = np.cross(self.normal, self.u)
        phase = 2 * np.pi * self.rate_hz * t
        return np.asarray(self.c + self.radius * (np.cos(phase) * self.u + np.sin(phase) * v))

    def look_at(self, t: float) -> Matrix:
        """Return L(t), (3, 3): rows are the right, down and forward axes of a camera at C(t) that looks at c.

        The paper puts the viewing direction into the first row; the optical frame (z forward) needs it in the third.
        """
        forward = (self.c - self.camera_center(t)) / self.radius
        down = -self.normal
        return np.stack([np.cross(down, forward), down, forward])

    def world_to_camera(self, t: float) -> tuple[Matrix, Vector]:
        """Return R(t) = R0 L(t) and the translation -R(t) C(t) (the paper prints +C)."""
        R = self.R0 @ self.look_at(t)
        return R, -R @ self.camera_center(t)


@dataclass(frozen=True)
class Spin:
    """Motion of an object that spins about a fixed axis, in the camera's optical frame.

    axis: (3,) unit vector, right-handed with the spin. rate_hz: turns per second, > 0.
    center: (3,) a point of the axis. t0: ns, when object coordinates and camera-aligned coordinates agree.
    """

    axis: Vector
    rate_hz: float
    center: Vector
    t0: int

    def angle(self, t: NDArray[np.int64]) -> Vector:
        """Angle turned since t0 in radians at the times `t` (N,) in ns."""
        return np.asarray(2 * np.pi * self.rate_hz * ((t - self.t0) / NS_PER_S))

    def transform(self, X: Matrix, t: int) -> Matrix:
        """Move (P, 3) object points to the camera frame at time `t` in ns."""
        R = rotation(self.axis, float(self.angle(np.asarray(t))))
        return np.asarray(X @ R.T + self.center)

    def paper_orbit(self) -> PaperOrbit:
        """Return the equivalent orbiting camera. Raises OrbitError when the axis passes through the camera."""
        along = float(self.center @ self.axis)
        perpendicular = self.center - along * self.axis
        radius = float(np.linalg.norm(perpendicular))
        if radius <= 1e-12 * np.linalg.norm(self.center):
            raise OrbitError("the axis passes through the camera centre: the orbit has no radius")
        n, u = -self.axis, -perpendicular / radius
        c = -along * self.axis
        L0 = PaperOrbit(radius, self.rate_hz, np.eye(3), n, u, c).look_at(0.0)
        return PaperOrbit(radius, self.rate_hz, L0.T, n, u, c)

    def screw_line(self, camera: Camera, half_length: float) -> NDArray[np.float64]:
        """Image of the axis (paper, section 6.3): (K, 2) pixels of the part within `half_length` of the centre.

        Sampled, so that lens distortion bends it; parts behind the camera are left out.
        """
        s = np.linspace(-half_length, half_length, 64)
        X = self.center + s[:, None] * self.axis
        return camera.project(X[X[:, 2] > 1e-3 * np.linalg.norm(self.center)])


def object_frame(axis: Vector) -> Matrix:
    """Rotation camera <- object, (3, 3), of the published object frame at t0: its z axis is the spin axis.

    The x axis is the camera's x axis made perpendicular to the spin axis (or its y axis, should they be parallel),
    which is a convention: the phase of an object is not observable.
    """
    seed = np.array([1.0, 0, 0]) if abs(axis[0]) < 0.9 else np.array([0, 1.0, 0])
    x = seed - (seed @ axis) * axis
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def tangent_basis(axis: Vector) -> Matrix:
    """Two unit vectors (3, 2) perpendicular to `axis`: the coordinates in which axis covariances are given."""
    return object_frame(axis)[:, :2]


def angle_between(a: Vector, b: Vector) -> float:
    """Angle between two vectors (3,) in degrees, accurate also for small angles."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))
