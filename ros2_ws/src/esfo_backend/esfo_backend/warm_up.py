"""Compiling everything before the first estimate, or loading what was compiled before."""

from __future__ import annotations

import numpy as np

from esfo_backend.backend import Backend
from esfo_backend.options import BackendOptions, StartOptions
from esfo_core.camera import Camera
from esfo_core.orbit import Spin
from esfo_core.simulation.activity import synthetic_activity
from esfo_core.simulation.tracks import SyntheticTrackOptions, synthetic_tracks
from esfo_core.tracks import TrackUpdate

_RATE_HZ = 5.0
_DURATION_S = 0.5


def warm_up() -> None:
    """Search a small scene, and follow it once, so that compiling costs no live estimate."""
    camera = Camera.pinhole(160, 120, 200.0)
    spin = Spin(np.array([0.3, -0.8, 0.4]) / np.linalg.norm([0.3, -0.8, 0.4]), _RATE_HZ, np.array([0.0, 0.0, 4.0]), 0)
    ball = SyntheticTrackOptions(points=20, duration_s=_DURATION_S, window_s=0.002, track_s=0.04)
    scene = synthetic_tracks(spin, camera, ball)
    activity = synthetic_activity(spin, scene.points, camera, _DURATION_S)
    backend = Backend(camera, BackendOptions(start=StartOptions(axes=4)))
    backend.add(TrackUpdate(scene.tracks, np.empty(0, np.uint32)), activity)
    for _ in range(2):
        backend.solve(thorough=False)
