"""First values for the factor graph: COLMAP (paper), the direct search, or whichever explains the tracks better."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution, bundle_adjustment, linear_points
from esfo_backend.errors import BackendError
from esfo_backend.initialise.axis_search import AxisSearchResult, search_axis
from esfo_backend.initialise.colmap import ColmapResult, run_colmap
from esfo_backend.options import BackendOptions
from esfo_backend.orbit.observations import Observations
from esfo_backend.orbit.parametrization import Motion
from esfo_core.camera import Camera
from esfo_core.tracks import Tracks

Method = Literal["colmap", "direct"]

_TIE = 0.01
"""Relative cost below which two starts are the same optimum, reached to different depths."""

_CERTAIN_RATIO = 2.0
"""A start is certain when every other axis costs this many times as much: COLMAP could but find the same
optimum once more. Tracks that follow no motion cost the same at every axis, so that many of them leave a doubt."""


@dataclass(frozen=True)
class Initialisation:
    """The start that is used, where it came from, and the next best optimum of another axis, if any.

    colmap_note: what COLMAP found or why it was not used, for the log. colmap: its model, where there is one.
    """

    solution: OrbitSolution
    name: Method
    second: OrbitSolution | None
    colmap_note: str
    colmap: ColmapResult | None = None

    @property
    def certain(self) -> bool:
        """Whether no second optimum comes near."""
        return self.second is None or self.second.cost >= _CERTAIN_RATIO * self.solution.cost


def initialise(
    tracks: Tracks, obs: Observations, camera: Camera, rate_hz: float, options: BackendOptions, thorough: bool
) -> Initialisation:
    """Make the starts that the options ask for and take the one of lower robust cost; COLMAP's on a tie.

    obs: one point per track. thorough: without it, `best` is the direct start. With it, `best` asks COLMAP as well
    unless the direct start is certain.
    Raises BackendError when no start succeeds.
    """
    method = options.initialisation.method
    direct = None if method == "colmap" else search_axis(obs, rate_hz, options.initialisation)
    if direct is not None:
        if method == "direct" or (method == "best" and not thorough):
            return _alone(direct, "COLMAP was not asked for")
        alone = _alone(direct, "COLMAP was not needed")
        if method == "best" and alone.certain:
            return alone
    second = direct.second if direct else None
    model: ColmapResult | None = None
    try:
        model = run_colmap(tracks, camera, options.initialisation)
        motion = _accepted(model, rate_hz, options)
    except BackendError as error:
        if direct is None:
            raise
        return _alone(direct, str(error), model)
    free = options.rate.method == "fourier"
    refined = bundle_adjustment(motion, linear_points(motion, obs), obs, options.initialisation.cauchy_px, free)
    note = f"COLMAP registered {model.registered} of {model.views} views at {model.rms_px:.2f} px"
    if direct is None or refined.cost <= direct.best.cost * (1 + _TIE):
        return Initialisation(refined, "colmap", second, note, model)
    return _alone(direct, f"{note}, at {refined.cost / direct.best.cost:.2f} times the cost", model)


def _alone(direct: AxisSearchResult, note: str, model: ColmapResult | None = None) -> Initialisation:
    return Initialisation(direct.best, "direct", direct.second, note, model)


def _accepted(model: ColmapResult, rate_hz: float, options: BackendOptions) -> Motion:
    """Check COLMAP's cameras against a circle and against the rate of the event stream.

    The paper has no such check and takes the rate of the FFT: so does `rate.method = fourier`. Otherwise the rate of
    the event stream is held, since it is far more precise than a phase slope.
    """
    motion = Motion(model.orbit.motion.Q, rate_hz)
    if options.rate.method == "fourier":
        return motion
    if model.registered < options.initialisation.colmap_min_share * model.views:
        raise BackendError(f"COLMAP registered only {model.registered} of {model.views} views")
    if model.orbit.circle_residual > options.initialisation.colmap_circle:
        raise BackendError(f"COLMAP's cameras are {model.orbit.circle_residual:.0%} of the radius off a circle")
    slope = model.orbit.motion.rate_hz
    if abs(slope / rate_hz - 1) > options.initialisation.colmap_rate:
        raise BackendError(f"COLMAP's cameras turn at {slope:.4f} Hz, the event stream at {rate_hz:.4f} Hz")
    return motion
