"""Initial values for the factor graph: COLMAP (paper), the axis search, or the one of lower cost."""

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
"""Relative difference of cost below which two initialisations are the same optimum, before full convergence."""

_CERTAIN_RATIO = 2.0
"""An initialisation is certain when the cost of every other axis is at least this many times as large; COLMAP is not
run then. Outlier tracks cost the same at every axis, so many of them make it uncertain."""


@dataclass(frozen=True)
class Initialisation:
    """Initial values, their method, and the second best optimum, of another axis, if any.

    colmap_note: COLMAP's result or why it was not used, for the log. colmap: its model, if any.
    """

    solution: OrbitSolution
    name: Method
    second: OrbitSolution | None
    colmap_note: str
    colmap: ColmapResult | None = None

    @property
    def certain(self) -> bool:
        """Whether no second optimum has a similar cost."""
        return self.second is None or self.second.cost >= _CERTAIN_RATIO * self.solution.cost


def initialise(
    tracks: Tracks, obs: Observations, camera: Camera, rate_hz: float, options: BackendOptions, thorough: bool
) -> Initialisation:
    """Run the methods that the options ask for and take the result of lower robust cost; COLMAP's on a tie.

    obs: one landmark per track. thorough: without it, `best` is the axis search. With it, `best` runs COLMAP as well
    unless the axis search is certain.
    Raises BackendError when no method succeeds.
    """
    method = options.initialisation.method
    direct = None if method == "colmap" else search_axis(obs, rate_hz, options.initialisation)
    if direct is not None:
        if method == "direct" or (method == "best" and not thorough):
            return _from_axis_search(direct, "COLMAP was not requested")
        searched = _from_axis_search(direct, "COLMAP was not needed")
        if method == "best" and searched.certain:
            return searched
    second = direct.second if direct else None
    model: ColmapResult | None = None
    try:
        model = run_colmap(tracks, camera, options.initialisation)
        motion = _accepted(model, rate_hz, options)
    except BackendError as error:
        if direct is None:
            raise
        return _from_axis_search(direct, str(error), model)
    free = options.rate.method == "fourier"
    refined = bundle_adjustment(motion, linear_points(motion, obs), obs, options.initialisation.cauchy_px, free)
    note = f"COLMAP registered {model.registered} of {model.views} views at {model.rms_px:.2f} px"
    if direct is None or refined.cost <= direct.best.cost * (1 + _TIE):
        return Initialisation(refined, "colmap", second, note, model)
    return _from_axis_search(direct, f"{note}, at {refined.cost / direct.best.cost:.2f} times the cost", model)


def _from_axis_search(direct: AxisSearchResult, note: str, model: ColmapResult | None = None) -> Initialisation:
    return Initialisation(direct.best, "direct", direct.second, note, model)


def _accepted(model: ColmapResult, rate_hz: float, options: BackendOptions) -> Motion:
    """Check that COLMAP's cameras lie on a circle and have the rate of the event stream.

    The paper has no such check and uses the rate of the FFT, as does `rate.method = fourier`. Otherwise the rate of the
    event stream is used, which is far more precise than the phase slope.
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
        raise BackendError(
            f"the spin rate of COLMAP's cameras is {slope:.4f} Hz, that of the event stream {rate_hz:.4f} Hz"
        )
    return motion
