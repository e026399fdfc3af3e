"""Spin rate, axis and structure of a spinning object from an event camera, in Python: see docs/python.md.

The steps of a run are functions: `open`, `track`, `estimate`, or `run` for the last two; `simulate` writes a recording
with known motion. The pieces under them are re-exported with the types that they take and return.
"""

from esfo.result import Result, TrackedRecording
from esfo.steps import estimate, open, run, settings, simulate, track
from esfo_backend.backend import Backend
from esfo_backend.options import BackendOptions
from esfo_bringup.offline.source import Source
from esfo_bringup.settings import RunSettings
from esfo_core import __version__
from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.errors import EsfoError
from esfo_core.estimate import OrbitEstimate
from esfo_core.events import EVENT_DTYPE, EventArray, make_events
from esfo_core.orbit import Spin
from esfo_core.recordings import Recording
from esfo_core.tracks import Tracks, TrackUpdate
from esfo_frontend.frontend import Frontend, FrontendOutput
from esfo_frontend.options import FrontendOptions
from esfo_simulation.scene import Scene, SceneOptions
from esfo_simulation.truth import Truth

__all__ = [
    "EVENT_DTYPE",
    "Activity",
    "Backend",
    "BackendOptions",
    "Camera",
    "EsfoError",
    "EventArray",
    "Frontend",
    "FrontendOptions",
    "FrontendOutput",
    "OrbitEstimate",
    "Recording",
    "Result",
    "RunSettings",
    "Scene",
    "SceneOptions",
    "Source",
    "Spin",
    "TrackUpdate",
    "TrackedRecording",
    "Tracks",
    "Truth",
    "__version__",
    "estimate",
    "make_events",
    "open",
    "run",
    "settings",
    "simulate",
    "track",
]
