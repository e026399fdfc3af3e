"""Landmarks and focal length in turn: a lens that is another one than assumed tears apart what is one point."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution, linear_points
from esfo_backend.adjustment.factor_graph import GraphOptimum
from esfo_backend.adjustment.focal_length import estimate_focal, with_focal
from esfo_backend.landmarks.landmarks import Landmarks
from esfo_backend.orbit.observations import Observations
from esfo_core.camera import Camera

_ROUNDS = 3
_SAME_LANDMARKS = 0.02
"""Relative change of the focal length that changes nothing about which tracks belong together."""

Refine = Callable[[OrbitSolution, Observations], tuple[Landmarks, GraphOptimum]]


def refine_focal(
    refine: Refine, start: OrbitSolution, obs: Observations, camera: Camera, noise: tuple[float, float]
) -> tuple[Landmarks, GraphOptimum, Camera]:
    """Find landmarks and their optimum by `refine`, and the focal length unless the camera is calibrated.

    start: of one point per track, of `obs`. noise: cauchy_px and bias_px of `estimate_focal`. Tracks are associated
    anew for a focal length that is another one. Returns the camera that belongs to the optimum.
    """
    landmarks, optimum = refine(start, obs)
    found = camera
    for _ in range(_ROUNDS if camera.focal_std > 0 else 0):
        focal = estimate_focal(landmarks.solution, landmarks.obs, camera, *noise)
        found = focal.camera
        factor = float(focal.obs.rows.focal[0] / landmarks.obs.rows.focal[0])
        if abs(np.log(factor)) < min(_SAME_LANDMARKS, 0.2 * found.focal_std):
            break
        obs, motion = with_focal(obs, factor), focal.solution.motion
        landmarks, optimum = refine(OrbitSolution(motion, linear_points(motion, obs), np.inf, 0), obs)
    fitted = camera.with_focal(camera.focal_px * landmarks.obs.rows.focal[0] / camera.K[0, 0], found.focal_std)
    return landmarks, optimum, fitted if camera.focal_std > 0 else camera
