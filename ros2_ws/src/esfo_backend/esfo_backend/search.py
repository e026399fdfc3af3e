"""The whole way from tracks and activity to an orbit, once: rate, start, re-identification, factor graph, verdict."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from esfo_backend.adjustment.factor_graph import GraphOptimum, optimise_graph
from esfo_backend.errors import BackendError
from esfo_backend.initialise.initialisation import Initialisation, initialise
from esfo_backend.landmarks.landmarks import Landmarks, build_landmarks, drop_far, prune
from esfo_backend.options import BackendOptions
from esfo_backend.orbit.parametrization import observations
from esfo_backend.spin_rate.aperiodic import explain_aperiodic
from esfo_backend.spin_rate.correlation import LARGEST_HARMONIC, Harmonic, SpinRate, correlation_rate, fourier_rate
from esfo_backend.spin_rate.rate_ramp import RateRamp, find_rate_ramp, warp_times
from esfo_backend.stopwatch import Stopwatch
from esfo_backend.verdict.build_estimate import Optimum, build_estimate, most_reobserved, recurring
from esfo_backend.verdict.verdict import unconfirmed
from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.estimate import OrbitEstimate
from esfo_core.orbit import NS_PER_S
from esfo_core.tracks import Tracks

_MOST_GRAPHS = 3


@dataclass(frozen=True)
class Found:
    """What a search found and a live estimate goes on from; turns: how many were seen then."""

    rate: SpinRate
    initialisation: Initialisation
    landmarks: Landmarks
    ids: NDArray[np.uint32]
    turns: float


class Solver:
    """Makes estimates. on_stage: told the name of each of STAGES as it begins.

    last_initialisation: of the last search. found: what it found, None where there is nothing that could go on.
    rate_hz: of the event stream, None before the first search.
    """

    def __init__(self, camera: Camera, options: BackendOptions) -> None:
        self.camera, self.options = camera, options
        self.on_stage: Callable[[str], None] = lambda name: None
        self.last_initialisation: Initialisation | None = None
        self.found: Found | None = None
        self.rate_hz: float | None = None
        self._ramp_searched_s = 0.0  # length of the stream when a quick search last looked for a rate that changes

    def search(self, tracks: Tracks, activity: Activity, thorough: bool) -> OrbitEstimate:
        """Estimate from nothing but the data; a failure says why there is none. thorough: as in `Backend.solve`."""
        self.found = None
        known = {
            "tracks": len(np.unique(tracks.track_id)),
            "observations": len(tracks),
            "t_first": activity.t0,
            "t_last": activity.end,
        }
        watch = Stopwatch(self.on_stage)
        try:
            return self._solve(tracks, activity, watch, thorough)
        except BackendError as error:
            return OrbitEstimate.failure(str(error), flags=error.flags, timing_s=watch.seconds, **known)

    def _solve(self, tracks: Tracks, activity: Activity, watch: Stopwatch, thorough: bool) -> OrbitEstimate:
        """Take the rate for constant first, and for one that changes evenly where that does not hold.

        The paper's rate is taken as it is.
        """
        if self.options.rate.method == "fourier":
            with watch.stage("spin_rate"):
                rate = SpinRate(fourier_rate(activity, self.options.rate.fourier_window_s), np.nan, np.nan, ())
            return self._solve_at(rate, None, tracks, activity, watch, thorough)
        try:
            with watch.stage("spin_rate"):
                rate = correlation_rate(activity, self.options.rate)
        except BackendError as error:
            return self._solve_ramp(tracks, activity, watch, thorough, error)
        try:
            first = self._solve_at(rate, None, tracks, activity, watch, thorough)
        except BackendError as error:
            other = self._second_opinion(rate, tracks, activity, watch, thorough)
            if isinstance(other, OrbitEstimate):
                return other
            self.rate_hz = rate.rate_hz
            raise (other or error) from error
        if _is_one_rotation(first):
            return first
        kept = self.found
        other = self._second_opinion(rate, tracks, activity, watch, thorough)
        if isinstance(other, OrbitEstimate):
            return other
        self.found, self.rate_hz = kept, rate.rate_hz
        return first

    def _second_opinion(
        self, rate: SpinRate, tracks: Tracks, activity: Activity, watch: Stopwatch, thorough: bool
    ) -> OrbitEstimate | BackendError | None:
        """Try the multiples of the period, then a rate that changes; None: nothing better.

        An error says that the rate changes, and why there is no estimate all the same; where that period is not
        confirmed either it says nothing.
        """
        best = None
        for slower in _slower(rate, thorough):
            with suppress(BackendError):
                found = self._solve_at(slower, None, tracks, activity, watch, False)
                confirmed = (
                    found.status == "ok"
                    and self.found is not None
                    and most_reobserved(self.found.landmarks, self.options)
                )
                if confirmed and (best is None or found.observations > best[0].observations):
                    best = found, self.found, self.last_initialisation, slower.rate_hz
        if best is not None:
            found, self.found, self.last_initialisation, self.rate_hz = best
            return found
        try:
            found = self._solve_ramp(tracks, activity, watch, thorough, None)
        except BackendError as error:
            changes = "rate_not_constant" in error.flags and not {"too_few_turns", "not_a_rotation"} & set(error.flags)
            return error if changes else None
        return None if found.status == "failed" or "not_a_rotation" in found.flags else found

    def _solve_ramp(
        self, tracks: Tracks, activity: Activity, watch: Stopwatch, thorough: bool, error: BackendError | None
    ) -> OrbitEstimate:
        """Solve for a rate that changes evenly. error: why there is no constant one; raised anew with its cause."""
        try:
            with watch.stage("spin_rate"):
                ramp = self._find_rate_ramp(activity, thorough)
        except BackendError:
            if error is None:
                raise
            raise self._aperiodic(str(error), tracks, activity) from error
        if error is None and abs(ramp.slope) < self.options.verdict.rate_slope_z * ramp.slope_std:
            raise BackendError(f"the rate is constant: {ramp.slope:+.5f} +- {ramp.slope_std:.5f} Hz per second")
        try:
            return self._solve_at(ramp.rate, ramp, tracks, activity, watch, False)
        except BackendError as later:
            raise BackendError(f"{ramp}; {later}", "rate_not_constant", *later.flags) from later

    def _find_rate_ramp(self, activity: Activity, thorough: bool) -> RateRamp:
        """Look for a rate that changes. It takes long: a quick search does so when the stream has doubled in length."""
        seconds = (activity.end - activity.t0) / NS_PER_S
        if not thorough and self._ramp_searched_s <= seconds < 2 * self._ramp_searched_s:
            raise BackendError("no rate that changes was looked for")
        self._ramp_searched_s = seconds
        return find_rate_ramp(activity, self.options.rate)

    def _solve_at(
        self,
        rate: SpinRate,
        ramp: RateRamp | None,
        tracks: Tracks,
        activity: Activity,
        watch: Stopwatch,
        thorough: bool,
    ) -> OrbitEstimate:
        """Paper, section 5: start and factor graph; between them the re-identification of docs/method.md."""
        options = self.options
        self.rate_hz = rate.rate_hz
        span = ramp.span if ramp else (activity.t0, activity.end)
        turns = rate.rate_hz * (span[1] - span[0]) / NS_PER_S
        if turns < options.live.min_revolutions:
            raise BackendError(
                f"{turns:.2f} turns were seen; {options.live.min_revolutions} are needed", "too_few_turns"
            )
        obs, ids = observations(tracks, self.camera, options.initialisation.min_observations)
        if ramp:
            obs = warp_times(obs, ramp)
        with watch.stage("initialisation"):
            initialisation = initialise(tracks, obs, self.camera, rate.rate_hz, options, thorough)
        self.last_initialisation = initialisation
        with watch.stage("reidentification"):
            landmarks = build_landmarks(initialisation.solution, obs, options)
        with watch.stage("graph"):
            landmarks, result = self._optimise(prune(landmarks, options))
        if ramp is None and options.rate.method == "correlation":
            of_tracks = result.solution.motion.rate_hz
            if not rate.agrees_with(of_tracks):
                disagree = (
                    f"the tracks turn at {of_tracks:.4f} Hz, but the event stream repeats at {rate.rate_hz:.4f} Hz"
                )
                raise self._aperiodic(disagree, tracks, activity)
        self.found = None if ramp else Found(rate, initialisation, landmarks, ids, turns)
        optimum = Optimum(landmarks, result, rate, initialisation, span, ramp)
        estimate = build_estimate(optimum, options, watch.seconds)
        unnamed = estimate.status == "failed" and not estimate.flags
        if unnamed and unconfirmed(recurring(landmarks, options), options.verdict):
            raise self._aperiodic(estimate.reason, tracks, activity)
        return estimate

    def _optimise(self, landmarks: Landmarks) -> tuple[Landmarks, GraphOptimum]:
        """Optimise the graph; points that run away tell nothing of the motion, but may make it indeterminate."""
        graph = self.options.graph
        for _ in range(_MOST_GRAPHS):
            result = optimise_graph(landmarks.solution, landmarks.obs, graph.cauchy_px, graph.iterations)
            optimum = replace(landmarks, solution=result.solution)
            landmarks = drop_far(optimum)
            if landmarks.obs.points < self.options.verdict.min_points:
                return optimum, result
            if landmarks is optimum or np.isfinite(result.marginal).all():
                break
        return landmarks, result

    def _aperiodic(self, found: str, tracks: Tracks, activity: Activity) -> BackendError:
        """Error of a stream without a period, or with one that no track confirms; its cause by how they move."""
        duration_s = (activity.end - activity.t0) / NS_PER_S
        why = explain_aperiodic(tracks, duration_s, self.options.verdict.min_points, self.camera.focal_px)
        return BackendError(f"{found}; {why.reason}", why.flag)


def _slower(rate: SpinRate, thorough: bool) -> list[SpinRate]:
    """Multiples of a period, those first that the stream has shown; the others are tried in a thorough search alone.

    An object that is symmetric about its axis looks the same after part of a turn, and only its tracks know how many
    such parts make one: as many as the most of them follow.
    """
    shown = [h.rate_hz for h in rate.harmonics if h.rate_hz < rate.rate_hz]
    others = [rate.rate_hz / k for k in range(2, LARGEST_HARMONIC + 1)] if thorough else []
    equal = Harmonic(rate.rate_hz, rate.correlation, 0.0)
    return [replace(rate, rate_hz=slower, harmonics=(equal, *rate.harmonics)) for slower in (*shown, *others)]


def _is_one_rotation(estimate: OrbitEstimate) -> bool:
    return estimate.status != "failed" and not {"rate_not_constant", "not_a_rotation"} & set(estimate.flags)
