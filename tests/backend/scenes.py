"""Scenes with exact truth that several back-end tests share."""

from __future__ import annotations

import numpy as np

from esfo_backend.backend import Backend
from esfo_backend.options import BackendOptions
from esfo_core.camera import Camera
from esfo_core.orbit import Spin
from esfo_core.tracks import TrackUpdate
from esfo_simulation.activity import synthetic_activity
from esfo_simulation.tracks import SyntheticTrackOptions, SyntheticTracks, synthetic_tracks

CAMERA = Camera.pinhole(640, 480, 800.0)
NONE_ENDED = np.empty(0, np.uint32)


def unit(*v: float) -> np.ndarray:
    """Return the unit vector along v."""
    return np.array(v) / np.linalg.norm(v)


def spin(axis: np.ndarray, rate_hz: float = 0.5, t0: int = 1_700_000_000_123_456_789) -> Spin:
    """Spin of an object 4 units in front of the camera, a little off its optical axis."""
    return Spin(axis, rate_hz, np.array([0.1, 0.05, 4.0]), t0)


def tracks_of(motion: Spin, **options: float) -> SyntheticTracks:
    """Tracks of a ball seen by CAMERA."""
    return synthetic_tracks(motion, CAMERA, SyntheticTrackOptions(**options))  # type: ignore[arg-type]


def backend_for(scene: SyntheticTracks, duration_s: float = 4.0, options: BackendOptions | None = None) -> Backend:
    """Back-end that has received the whole scene."""
    backend = Backend(CAMERA, options)
    activity = synthetic_activity(scene.spin, scene.points, CAMERA, duration_s)
    backend.add(TrackUpdate(scene.tracks, NONE_ENDED), activity)
    return backend
