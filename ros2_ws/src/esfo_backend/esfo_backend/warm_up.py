"""Compilation of all kernels, or loading of the compiled ones, before the first estimate."""

from __future__ import annotations

import numpy as np

from esfo_backend.backend import Backend
from esfo_backend.options import BackendOptions, InitialisationOptions
from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.events import make_events
from esfo_core.orbit import Spin
from esfo_core.tracks import Tracks, TrackUpdate

_CAMERA = Camera.pinhole(160, 120, 200.0)
_SPIN = Spin(np.array([0.3, -0.8, 0.4]) / np.linalg.norm([0.3, -0.8, 0.4]), 5.0, np.array([0.0, 0.0, 4.0]), 0)
_STEPS, _STEP_NS, _POINTS = 250, 2_000_000, 20
_STEPS_PER_TRACK = 20
_BIN_NS, _CELL = 5_000_000, 32


def warm_up() -> None:
    """Run a search and an incremental estimate on a small scene, so that no live estimate waits for compilation."""
    tracks, activity = _scene()
    backend = Backend(_CAMERA, BackendOptions(initialisation=InitialisationOptions(axes=4)))
    backend.add(TrackUpdate(tracks, np.empty(0, np.uint32)), activity)
    for _ in range(2):
        backend.solve(thorough=False)


def _scene() -> tuple[Tracks, Activity]:
    """Tracks of points of a spinning ball while they face the camera, and one event per observation."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(_POINTS, 3))
    points = normals / np.linalg.norm(normals, axis=1)[:, None]
    times = np.arange(_STEPS, dtype=np.int64) * _STEP_NS
    X = np.array([_SPIN.transform(points, int(t)) for t in times])
    seen = np.einsum("tpi,tpi->tp", X - _SPIN.center, X) < 0
    step, point = np.nonzero(seen)
    uv = _CAMERA.project(X[step, point])
    track_id = point * _STEPS + (step + point) // _STEPS_PER_TRACK
    tracks = Tracks.from_columns(track_id, times[step], uv, np.full(len(step), 0.1))
    events = make_events(uv[:, 0], uv[:, 1], point % 2, times[step])
    bins = int(_STEPS * _STEP_NS // _BIN_NS)
    grid = (-(-_CAMERA.height // _CELL), -(-_CAMERA.width // _CELL))
    return tracks, Activity.from_events(events, 0, bins, _BIN_NS, _CELL, grid)
