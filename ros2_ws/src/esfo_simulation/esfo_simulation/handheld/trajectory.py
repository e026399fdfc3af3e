"""The free motion of a hand-held camera: sums of sinusoids of position and orientation, with rising frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from esfo_core.events import NS_PER_S
from esfo_core.orbit import Matrix, Vector

FORWARD = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""Rotation optical frame -> world (x right, y ahead, z up) of a level camera that looks along the world's y axis."""

REACH_M = (0.25, 0.15, 0.20)
"""How far the camera ever gets from where it rests: to the side, ahead and up."""

REACH_RAD = (0.26, 0.38, 0.44)
"""How far it ever turns about its own x (tilt), y (pan) and z axis (roll)."""

PACE_HZ, PACE_GROWTH_HZ_S = 0.4, 0.03
"""Mean frequency of the sinusoids at the start, and its growth per second."""

MOTIONS = {"6dof": (1.0, 1.0), "rotation": (1 / 3, 1.0), "translation": (1.0, 1 / 3)}
"""Shares of the full reach in position and in orientation: a hand that turns a camera also moves it, and back."""

_WAVES = 4


@dataclass(frozen=True)
class HandheldTrajectory:
    """A camera pose at any time, smooth, and bounded by the sums of the amplitudes.

    span: begin and end, ns. amplitude, frequency, phase: (6, K) of the sinusoids of the position x, y, z in the world
    (m) and of the rotation vector about the x, y and z axis of the resting camera (rad); frequencies in cycles per unit
    of the phase that grows with the pace; phases in rad. pace: Hz at the begin, and its growth in Hz/s.
    The camera rests in the origin of the world and looks along its y axis.
    """

    span: tuple[int, int]
    amplitude: Matrix
    frequency: Matrix
    phase: Matrix
    pace: tuple[float, float]

    def camera_poses(self, t: NDArray[np.generic]) -> tuple[Matrix, Matrix]:
        """Return positions (N, 3) in metres and orientations (N, 4) of the camera in the world at `t` (N,) ns.

        Orientations are unit quaternions x, y, z, w, from the camera's optical frame to the world.
        """
        offset = self._offsets(t)
        turned = Rotation.from_matrix(FORWARD) * Rotation.from_rotvec(offset[:, 3:])
        return offset[:, :3], np.asarray(turned.as_quat())

    def camera_pose(self, t: float) -> tuple[Vector, Vector]:
        """Return position (3,) and orientation (4,) at `t` ns, as `camera_poses`."""
        position, orientation = self.camera_poses(np.array([t]))
        return position[0], orientation[0]

    def pose(self, t: float) -> tuple[Matrix, Vector]:
        """Return R (3, 3) and T (3,), metres, at `t` ns: the world's point X is at R X + T in the optical frame."""
        position, orientation = self.camera_pose(t)
        R = Rotation.from_quat(orientation).as_matrix().T
        return R, -R @ position

    def _offsets(self, t: NDArray[np.generic]) -> Matrix:
        elapsed = np.asarray(t - self.span[0], np.float64) / NS_PER_S
        start, growth = self.pace
        cycles = elapsed * (start + 0.5 * growth * elapsed)
        angle = 2 * np.pi * self.frequency * cycles[:, None, None] + self.phase
        return np.asarray((self.amplitude * np.sin(angle)).sum(axis=2))


def random_trajectory(motion: str, span: tuple[int, int], seed: int, speed: float = 1.0) -> HandheldTrajectory:
    """Draw a trajectory.

    motion: one of `MOTIONS`. span: begin and end, ns. speed: factor on the pace. The same path over a longer span
    begins in the same way.
    """
    rng = np.random.default_rng(seed)
    shares = np.repeat(MOTIONS[motion], 3)
    reach = shares * (*REACH_M, *REACH_RAD)
    # Weights that add to 1 keep every component within its reach, whatever the phases.
    amplitude = reach[:, None] * rng.dirichlet(np.full(_WAVES, 4.0), 6)
    frequency = rng.uniform(0.5, 1.5, (6, _WAVES))
    phase = rng.uniform(0, 2 * np.pi, (6, _WAVES))
    return HandheldTrajectory(span, amplitude, frequency, phase, (speed * PACE_HZ, speed * PACE_GROWTH_HZ_S))
