"""Search: each rate hypothesis is evaluated to a candidate, and one candidate is chosen.

A hypothesis is evaluated by the paper's steps (section 5), initialisation and factor graph, with the re-identification
of docs/method.md between them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution
from esfo_backend.adjustment.factor_graph import GraphOptimum, optimise_graph
from esfo_backend.errors import BackendError
from esfo_backend.initialise.axis_search import search_axis
from esfo_backend.initialise.initialisation import Initialisation, initialise
from esfo_backend.initialise.rate_evidence import RateComparison, compare_rates, second_axis_z
from esfo_backend.landmarks.landmarks import Landmarks, build_landmarks, drop_far, prune
from esfo_backend.landmarks.refine_focal import refine_focal
from esfo_backend.options import BackendOptions
from esfo_backend.orbit.observations import Observations, observations
from esfo_backend.orbit.selection import longest_points
from esfo_backend.spin_rate.aperiodic import explain_aperiodic
from esfo_backend.spin_rate.correlation import LARGEST_HARMONIC, SpinRate
from esfo_backend.spin_rate.hypotheses import RateHypothesis, Stream, rate_hypotheses
from esfo_backend.spin_rate.rate_ramp import warp_times
from esfo_backend.stopwatch import Stopwatch
from esfo_backend.verdict.build_estimate import (
    Optimum,
    build_estimate,
    most_reobserved,
    reobserved,
    with_axis_comparison,
    with_comparisons,
    with_stream_rate,
)
from esfo_backend.verdict.verdict import unconfirmed
from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.estimate import OrbitEstimate
from esfo_core.events import NS_PER_S
from esfo_core.tracks import Tracks

_MAX_GRAPHS = 3


@dataclass(frozen=True)
class SearchInput:
    """What a search is made from.

    levels: of the activity pyramid, finest first, if there is one. on_stage: told the name of each of STAGES as it
    begins.
    """

    tracks: Tracks
    activity: Activity
    levels: Sequence[Activity]
    camera: Camera
    options: BackendOptions
    on_stage: Callable[[str], None] = lambda name: None

    @property
    def duration_s(self) -> float:
        """Length of the stream in s."""
        return (self.activity.end - self.activity.t0) / NS_PER_S

    def failure(self, error: BackendError) -> OrbitEstimate:
        """Return a failed estimate with the error as its reason."""
        known = {"tracks": len(np.unique(self.tracks.track_id)), "observations": len(self.tracks)}
        span = {"t_first": self.activity.t0, "t_last": self.activity.end}
        return OrbitEstimate.failure(str(error), flags=error.flags, **known, **span)


@dataclass(frozen=True)
class Candidate:
    """Evaluation of a rate hypothesis.

    estimate: failed where they do not. initialisation, landmarks: None where it did not come to them. track_ids: (M,)
    track of each entry of `landmarks.label`. comparisons: with other rates, where a constant rate was estimated.
    """

    hypothesis: RateHypothesis
    estimate: OrbitEstimate
    initialisation: Initialisation | None = None
    landmarks: Landmarks | None = None
    track_ids: NDArray[np.uint32] | None = None
    comparisons: tuple[RateComparison, ...] = ()

    @property
    def is_one_rotation(self) -> bool:
        """Whether a constant rate about one axis explains the tracks, and no other rate does so better."""
        other_motion = {"rate_not_constant", "not_a_rotation"} & set(self.estimate.flags)
        return self.estimate.status != "failed" and not other_motion and all(c.z > 0 for c in self.comparisons)


@dataclass(frozen=True)
class SearchResult:
    """Outcome of a search.

    rate: of the event stream, None without a period. ramp_searched: whether a rate ramp was searched. The others: as in
    `Candidate`.
    """

    estimate: OrbitEstimate
    rate: SpinRate | None
    hypothesis: RateHypothesis
    initialisation: Initialisation | None
    landmarks: Landmarks | None
    track_ids: NDArray[np.uint32] | None
    ramp_searched: bool

    @property
    def note(self) -> str:
        """Result of COLMAP, or why it was not used."""
        return "" if self.initialisation is None else self.initialisation.colmap_note


def search(data: SearchInput, thorough: bool = True, ramp_after_s: float = 0.0) -> SearchResult:
    """Estimate without an earlier estimate; a failed estimate gives the reason.

    The period of the event stream comes first. Other rates that the tracks fit better, and a rate that changes evenly,
    are tried where no one rotation at that period explains the tracks. thorough: try every initialisation that the
    options ask for, and all multiples of the period. ramp_after_s: length of the stream in s from which a rate ramp is
    searched.
    """
    watch = Stopwatch(data.on_stage)
    candidates: list[Candidate] = []

    def preferred(rate: SpinRate) -> list[float]:
        return _preferred_rates(rate, data, watch, thorough)

    stream = Stream(data.activity, data.levels)
    for hypothesis in rate_hypotheses(stream, data.options, watch, preferred, ramp_after_s):
        candidates.append(_evaluate(hypothesis, data, watch, thorough and not candidates))
        if candidates[0].is_one_rotation:
            break
    first, chosen = candidates[0], _choose(candidates, data.options)
    last = candidates[-1].hypothesis
    settled = first.is_one_rotation and not first.hypothesis.alone
    estimate = with_stream_rate(chosen.estimate, first.hypothesis.rate if first.hypothesis.kind == "period" else None)
    return SearchResult(
        estimate=replace(estimate, timing_s=watch.seconds),
        rate=(first if chosen.estimate.status == "failed" else chosen).hypothesis.rate,
        hypothesis=chosen.hypothesis,
        initialisation=chosen.initialisation,
        landmarks=chosen.landmarks,
        track_ids=chosen.track_ids,
        ramp_searched=not settled and last.kind != "fourier" and data.duration_s >= ramp_after_s,
    )


def _choose(candidates: Sequence[Candidate], options: BackendOptions) -> Candidate:
    """Take the first candidate, unless it is not one rotation and a multiple or a ramp explains the tracks."""
    first, last = candidates[0], candidates[-1]
    if first.is_one_rotation or last is first:
        return first
    multiples = [c for c in candidates if c.hypothesis.kind == "multiple" and _explains_tracks(c, options)]
    if multiples:
        return max(multiples, key=lambda c: c.estimate.observations)
    return last if last.hypothesis.kind == "ramp" and _ramp_accepted(last) else first


def _explains_tracks(candidate: Candidate, options: BackendOptions) -> bool:
    landmarks = candidate.landmarks
    return candidate.estimate.status == "ok" and landmarks is not None and most_reobserved(landmarks, options)


def _ramp_accepted(candidate: Candidate) -> bool:
    """Whether to report the rate ramp, also without landmarks; not for another motion than a rotation."""
    flags = set(candidate.estimate.flags)
    if candidate.landmarks is None:
        return not {"too_few_turns", "not_a_rotation"} & flags
    return candidate.estimate.status != "failed" and "not_a_rotation" not in flags


def _evaluate(hypothesis: RateHypothesis, data: SearchInput, watch: Stopwatch, thorough: bool) -> Candidate:
    try:
        prepared = _prepare(hypothesis, data, watch, thorough)
    except BackendError as error:
        return Candidate(hypothesis, data.failure(_with_ramp(error, hypothesis)))
    try:
        landmarks, estimate = _refine(hypothesis, prepared, data, watch)
    except BackendError as error:
        return Candidate(hypothesis, data.failure(_with_ramp(error, hypothesis)), prepared.initialisation)
    if hypothesis.kind not in ("period", "multiple") or estimate.spin is None:
        return Candidate(hypothesis, estimate, prepared.initialisation, landmarks, prepared.track_ids)
    with watch.stage("initialisation"):
        comparisons = _compare(hypothesis, prepared, data)
        axis_z = second_axis_z(prepared.initialisation, prepared.obs, data.options.initialisation)
    estimate = with_axis_comparison(estimate, axis_z, data.options.verdict)
    estimate = with_comparisons(estimate, comparisons, data.options.verdict)
    return Candidate(hypothesis, estimate, prepared.initialisation, landmarks, prepared.track_ids, comparisons)


def _compare(hypothesis: RateHypothesis, prepared: _Prepared, data: SearchInput) -> tuple[RateComparison, ...]:
    """Compare the rate with its nearest multiples and fractions, and with that of the event stream."""
    rate = prepared.rate
    others = {factor * rate.rate_hz for factor in (2, 3, 1 / 2, 1 / 3)}
    if hypothesis.kind == "multiple":
        others = {o for o in others if not rate.harmonics or abs(o / rate.harmonics[0].rate_hz - 1) > 1e-6}
        others.add(rate.harmonics[0].rate_hz)
    motion = prepared.initialisation.solution.motion
    return compare_rates(motion, prepared.obs, sorted(others), data.options.initialisation)


def _preferred_rates(rate: SpinRate, data: SearchInput, watch: Stopwatch, thorough: bool) -> list[float]:
    """Multiples and fractions of the period that the tracks fit better than the period itself, the best first.

    An object that is symmetric about its axis looks the same after part of a revolution: only its tracks tell how many
    such parts make one.
    """
    shown = {h.rate_hz for h in rate.harmonics if h.rate_hz < rate.rate_hz}
    parts = range(2, LARGEST_HARMONIC + 1 if thorough else 4)
    others = shown | {rate.rate_hz / k for k in parts} | {2 * rate.rate_hz, 3 * rate.rate_hz}
    options = data.options.initialisation
    try:
        obs, _ = observations(data.tracks, data.camera, options.min_observations)
        with watch.stage("initialisation"):
            motion = search_axis(longest_points(obs, options.search_tracks), rate.rate_hz, options).best.motion
            found = compare_rates(motion, obs, sorted(others), options)
    except BackendError:
        return []
    return [c.rate_hz for c in sorted(found, key=lambda c: c.z) if c.z < 0]


def _with_ramp(error: BackendError, hypothesis: RateHypothesis) -> BackendError:
    """Add the ramp to the message and the flags of an error that occurred with one."""
    if hypothesis.ramp is None:
        return error
    return BackendError(f"{hypothesis.ramp}; {error}", "rate_not_constant", *error.flags)


@dataclass(frozen=True)
class _Prepared:
    """Rate, observations, track id of each landmark (P,), span of the data in ns, and initialisation."""

    rate: SpinRate
    obs: Observations
    track_ids: NDArray[np.uint32]
    span: tuple[int, int]
    initialisation: Initialisation


def _prepare(hypothesis: RateHypothesis, data: SearchInput, watch: Stopwatch, thorough: bool) -> _Prepared:
    rate, ramp, options = hypothesis.rate, hypothesis.ramp, data.options
    if rate is None:
        raise _aperiodic(hypothesis.reason, data, hypothesis.flags)
    span = ramp.span if ramp else (data.activity.t0, data.activity.end)
    revolutions = rate.rate_hz * (span[1] - span[0]) / NS_PER_S
    if revolutions < options.live.min_revolutions:
        needed = options.live.min_revolutions
        raise BackendError(f"{revolutions:.2f} revolutions were observed; {needed} are needed", "too_few_turns")
    obs, track_ids = observations(data.tracks, data.camera, options.initialisation.min_observations)
    if ramp:
        obs = warp_times(obs, ramp)
    with watch.stage("initialisation"):
        initialisation = initialise(data.tracks, obs, data.camera, rate.rate_hz, options, thorough)
    return _Prepared(rate, obs, track_ids, span, initialisation)


def _refine(
    hypothesis: RateHypothesis, prepared: _Prepared, data: SearchInput, watch: Stopwatch
) -> tuple[Landmarks, OrbitEstimate]:
    options, rate = data.options, prepared.rate

    def refine(start: OrbitSolution, obs: Observations) -> tuple[Landmarks, GraphOptimum]:
        with watch.stage("reidentification"):
            landmarks = build_landmarks(start, obs, options)
        with watch.stage("graph"):
            return _optimise(prune(landmarks, options), options)

    noise = (options.graph.cauchy_px, options.graph.bias_px)
    landmarks, optimum, camera = refine_focal(
        refine, prepared.initialisation.solution, prepared.obs, data.camera, noise
    )
    tracks_hz = optimum.solution.motion.rate_hz
    if hypothesis.kind in ("period", "multiple") and not rate.agrees_with(tracks_hz):
        mismatch = f"the spin rate of the tracks is {tracks_hz:.4f} Hz, that of the event stream {rate.rate_hz:.4f} Hz"
        raise _aperiodic(mismatch, data)
    found = Optimum(landmarks, optimum, rate, prepared.initialisation, prepared.span, hypothesis.ramp, camera)
    estimate = build_estimate(found, options, watch.seconds)
    unnamed = estimate.status == "failed" and not estimate.flags
    if unnamed and unconfirmed(reobserved(landmarks, options), options.verdict):
        raise _aperiodic(estimate.reason, data)
    return landmarks, estimate


def _optimise(landmarks: Landmarks, options: BackendOptions) -> tuple[Landmarks, GraphOptimum]:
    """Optimise the factor graph, without landmarks of diverging depth: they may make the motion indeterminate."""
    for _ in range(_MAX_GRAPHS):
        optimum = optimise_graph(landmarks.solution, landmarks.obs, options.graph.cauchy_px, options.graph.iterations)
        at_optimum = replace(landmarks, solution=optimum.solution)
        landmarks = drop_far(at_optimum)
        if landmarks.obs.points < options.verdict.min_points:
            return at_optimum, optimum
        if landmarks is at_optimum or np.isfinite(optimum.marginal).all():
            break
    return landmarks, optimum


def _aperiodic(found: str, data: SearchInput, flags: tuple[str, ...] = ()) -> BackendError:
    """Error of a stream without a period, or with one that no track confirms; its cause by how tracks move.

    flags: of what the stream itself shows to be the cause, if it does.
    """
    why = explain_aperiodic(data.tracks, data.duration_s, data.options.verdict.min_points, data.camera.focal_px)
    named = flags if why.flag in flags or not why.flag else (*flags, why.flag)
    return BackendError(f"{found}; {why.reason}" if why.reason else found, *named)
