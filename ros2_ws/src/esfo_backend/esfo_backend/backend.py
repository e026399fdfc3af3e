"""The back-end: tracks and activity in, orbit out. All behaviour is here; nodes and commands only drive it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from esfo_backend.changing_rate import ChangingRate, bent, changing_rate
from esfo_backend.constancy import constancy
from esfo_backend.covariance import motion_covariance
from esfo_backend.direct import mean_direction
from esfo_backend.drift import RateDrift, rate_drift
from esfo_backend.errors import BackendError
from esfo_backend.follow import Follower
from esfo_backend.graph import GraphResult, optimise_graph
from esfo_backend.history import LONGEST_GAP_NS, History
from esfo_backend.no_period import why_no_period
from esfo_backend.options import BackendOptions
from esfo_backend.problem import observations, spin_and_points
from esfo_backend.projection import row_errors
from esfo_backend.reidentify import point_rms
from esfo_backend.scale import check_scale, metric
from esfo_backend.selection import spread_tracks
from esfo_backend.spin_rate import SpinRate, correlation_rate, fourier_rate
from esfo_backend.start import Start, choose_start
from esfo_backend.state import load_state, save_state
from esfo_backend.structure import Structure, build_structure, prune, recurring_points
from esfo_backend.verdict import Evidence, judge
from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.estimate import Alternative, OrbitEstimate
from esfo_core.options import check
from esfo_core.orbit import NANOSECONDS
from esfo_core.tracks import Tracks, TrackUpdate

_SEARCH_TRACKS = 4
"""Tracks that a live search uses, in multiples of those that a live estimate uses."""

_CERTAIN_TURNS = 8.0
"""Turns after which a live stream is not searched anew: neither period nor axis change their mind any more."""

STAGES = ("spin_rate", "start", "reidentification", "graph")
"""Names of the stages of an estimate, in their order."""


@dataclass
class _Stopwatch:
    on_stage: Callable[[str], None]
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        self.on_stage(name)
        begin = time.perf_counter()
        yield
        self.seconds[name] = round(time.perf_counter() - begin, 3)


@dataclass(frozen=True)
class _Found:
    """What a search found and a live estimate goes on from; turns: how many were seen then."""

    rate: SpinRate
    start: Start
    structure: Structure
    ids: NDArray[np.uint32]
    turns: float


class Backend:
    """Accumulates tracks and activity; estimates the orbit from all of them.

    `add` and `due` are cheap and may be called from another thread than `solve`. on_stage: told the name of each of
    STAGES as it begins. last_start: of the last estimate; last_start_note: what became of COLMAP's in it.
    """

    def __init__(self, camera: Camera, options: BackendOptions | None = None) -> None:
        self.options = options or BackendOptions()
        check(self.options)
        self.camera = camera
        self.on_stage: Callable[[str], None] = lambda name: None
        self.last_start: Start | None = None
        self.last_start_note = ""
        check_scale(self.options.scale)
        self._history = History(self.options.memory)
        self._follower = Follower(camera, self.options)
        self._news: list[Tracks] = []
        self._found: _Found | None = None
        self._lock = threading.Lock()
        self._solved_until: int | None = None
        self._rate_hz: float | None = None

    def add(self, update: TrackUpdate, activity: Activity | None) -> None:
        """Take over what the front-end learnt."""
        with self._lock:
            self._history.add(update, activity)
            if self._found is not None:
                self._news.append(update.observations)

    def counts(self) -> tuple[int, int]:
        """Numbers of track rows and of activity bins that are kept."""
        with self._lock:
            return self._history.rows, self._history.bins

    def due(self) -> bool:
        """True when enough sensor time has passed since the last estimate to make a new one."""
        live = self.options.live
        with self._lock:
            begin, end = self._history.begin, self._history.end
            if begin is None or end is None or not self._history.rows:
                return False
        if self._rate_hz is not None and (end - begin) / NANOSECONDS * self._rate_hz < live.min_turns:
            return False
        since = begin if self._solved_until is None else self._solved_until
        return end - since >= (live.search_s if self._found is None else live.interval_s) * NANOSECONDS

    def update(self, update: TrackUpdate, activity: Activity | None) -> OrbitEstimate | None:
        """`add`, then a quick `solve` if an estimate is due."""
        self.add(update, activity)
        return self.solve(thorough=False) if self.due() else None

    def save(self, path: Path) -> None:
        """Write everything that is kept, but the options, to a file. Raises StateError when that cannot be done."""
        with self._lock:
            save_state(path, self.camera, self._history)

    @staticmethod
    def load(path: Path, options: BackendOptions | None = None) -> Backend:
        """Go on from a saved state. Raises StateError for a file that is none, or of another version."""
        options = options or BackendOptions()
        camera, history = load_state(path, options.memory)
        backend = Backend(camera, options)
        backend._history = history
        return backend

    def solve(self, thorough: bool = True) -> OrbitEstimate:
        """Estimate the orbit from everything received so far; never raises for data that do not allow one.

        thorough: search anew with everything, from every start that the options ask for. Otherwise the last estimate
        goes on where there is one, in bounded work; where there is none, the direct start alone is tried where there is
        a choice, and with a bounded number of tracks.
        """
        estimate = None if thorough else self._follow()
        if estimate is None:
            estimate = self._search(thorough)
        with self._lock:
            self._history.rate_hz = estimate.spin.rate_hz if estimate.spin else self._rate_hz
            self._history.recurring = self._follower.recurring
        try:
            return metric(estimate, self.options.scale)
        except BackendError as error:
            return OrbitEstimate.failure(str(error), t_first=estimate.t_first, t_last=estimate.t_last)

    def _search(self, thorough: bool) -> OrbitEstimate:
        with self._lock:
            seen = self._history.seen()
            self._news = []
        if seen is None:
            return OrbitEstimate.failure("no events were received")
        self._found = None
        tracks = seen.tracks if thorough else spread_tracks(seen.tracks, _SEARCH_TRACKS * self.options.live.max_tracks)
        estimate = self._solve_stretch(tracks, seen.activity, thorough)
        found = self._found
        if estimate.spin is None or "rate_not_constant" in estimate.flags:
            self._found = None  # a motion of constant rate cannot go on
        elif found is not None:
            self._follower.begin(tracks, found.structure.solution.motion, found.ids, found.structure.label)
        if estimate.spin is not None and seen.begin < estimate.t_first:
            turns = estimate.spin.rate_hz * (estimate.t_last - seen.begin) / NANOSECONDS
            estimate = replace(estimate, t_first=seen.begin, revolutions=turns)
        return replace(estimate, flags=(*estimate.flags, "only_after_gap")) if seen.after_gap else estimate

    def _follow(self) -> OrbitEstimate | None:
        """Go on from the last estimate; None where a search has to be made."""
        found = self._found
        with self._lock:
            begin, end, after_gap = self._history.begin, self._history.end, self._history.after_gap
            news, self._news = Tracks.concatenate(self._news), []
        if found is None or self._solved_until is None or begin is None or end is None:
            return None
        turns = found.rate.rate_hz * (end - begin) / NANOSECONDS
        if end - self._solved_until > LONGEST_GAP_NS or 2 * found.turns <= min(turns, 2 * _CERTAIN_TURNS):
            return None
        watch = _Stopwatch(self.on_stage)
        try:
            with watch.stage("graph"):
                structure, result = self._follower.update(news)
            estimate = self._estimate(structure, result, found.rate, None, found.start, (begin, end), watch)
        except BackendError:
            return None
        self._solved_until = end
        if estimate.spin is None:
            return None
        return replace(estimate, flags=(*estimate.flags, "only_after_gap")) if after_gap else estimate

    def _solve_stretch(self, tracks: Tracks, activity: Activity, thorough: bool) -> OrbitEstimate:
        self._solved_until = activity.end
        known = {
            "tracks": len(np.unique(tracks.track_id)),
            "observations": len(tracks),
            "t_first": activity.t0,
            "t_last": activity.end,
        }
        watch = _Stopwatch(self.on_stage)
        try:
            return self._solve(tracks, activity, watch, thorough)
        except BackendError as error:
            return OrbitEstimate.failure(str(error), flags=error.flags, timing_s=watch.seconds, **known)

    def _solve(self, tracks: Tracks, activity: Activity, watch: _Stopwatch, thorough: bool) -> OrbitEstimate:
        """Take the rate for constant first, and for one that changes evenly where that does not hold."""
        try:
            with watch.stage("spin_rate"):
                rate = self._spin_rate(activity)
        except BackendError as error:
            if self.options.rate.method == "fourier":
                raise
            return self._solve_changing(tracks, activity, watch, error)
        estimate = self._solve_at(rate, None, tracks, activity, watch, thorough)
        if "rate_not_constant" not in estimate.flags or self.options.rate.method == "fourier":
            return estimate
        try:
            return self._solve_changing(tracks, activity, watch, None)
        except BackendError:
            return estimate

    def _solve_changing(
        self, tracks: Tracks, activity: Activity, watch: _Stopwatch, error: BackendError | None
    ) -> OrbitEstimate:
        """Solve for a rate that changes evenly. error: why there is no constant one; raised anew with its cause."""
        duration_s = (activity.end - activity.t0) / NANOSECONDS
        try:
            with watch.stage("spin_rate"):
                changing = changing_rate(activity, self.options.rate)
        except BackendError:
            if error is None:
                raise
            why = why_no_period(tracks, duration_s, self.options.verdict.min_points)
            raise BackendError(f"{error}; {why.reason}", why.flag) from error
        try:
            return self._solve_at(changing.rate, changing, tracks, activity, watch, False)
        except BackendError as later:
            raise BackendError(f"{changing}; {later}", "rate_not_constant", *later.flags) from later

    def _solve_at(
        self,
        rate: SpinRate,
        changing: ChangingRate | None,
        tracks: Tracks,
        activity: Activity,
        watch: _Stopwatch,
        thorough: bool,
    ) -> OrbitEstimate:
        """Paper, section 5: start and factor graph; between them the re-identification of docs/method.md."""
        options = self.options
        self._rate_hz = rate.rate_hz
        span = changing.span if changing else (activity.t0, activity.end)
        turns = rate.rate_hz * (span[1] - span[0]) / NANOSECONDS
        if turns < options.live.min_turns:
            raise BackendError(f"{turns:.2f} turns were seen; {options.live.min_turns} are needed", "too_few_turns")
        obs, ids = observations(tracks, self.camera, options.start.min_rows)
        if changing:
            obs = bent(obs, changing)
        with watch.stage("start"):
            start = choose_start(tracks, obs, self.camera, rate.rate_hz, options, thorough)
        self.last_start, self.last_start_note = start, start.colmap_note
        with watch.stage("reidentification"):
            structure = build_structure(start, obs, options)
        with watch.stage("graph"):
            structure = prune(structure, options)
            result = optimise_graph(
                structure.solution, structure.obs, options.graph.cauchy_px, options.graph.iterations
            )
        structure = replace(structure, solution=result.adjusted)
        self._found = None if changing else _Found(rate, start, structure, ids, turns)
        return self._estimate(structure, result, rate, changing, start, span, watch)

    def _spin_rate(self, activity: Activity) -> SpinRate:
        if self.options.rate.method == "fourier":
            return SpinRate(fourier_rate(activity, self.options.rate.fourier_window_s), np.nan, np.nan, ())
        return correlation_rate(activity, self.options.rate)

    def _estimate(
        self,
        structure: Structure,
        result: GraphResult,
        rate: SpinRate,
        changing: ChangingRate | None,
        start: Start,
        span: tuple[int, int],
        watch: _Stopwatch,
    ) -> OrbitEstimate:
        solution, obs, label = structure.solution, structure.obs, structure.label
        noise = (self.options.graph.cauchy_px, self.options.graph.bias_px)
        covariance = motion_covariance(solution, obs, result.marginal, *noise)
        drift = rate_drift(solution, obs, *noise)
        if changing:
            drift = RateDrift(changing.slope + drift.slope, drift.std)
        duration_s = (span[1] - span[0]) / NANOSECONDS
        revolutions = solution.motion.rate_hz * duration_s
        errors = row_errors(solution.motion.Q, solution.motion.rate_hz, solution.y, obs.rows)
        alternatives = _alternatives(rate, start)
        inliers = label >= 0
        verdict = judge(
            Evidence(
                solution.motion.rate_hz,
                solution.motion.axis,
                mean_direction(obs),
                covariance,
                obs.points,
                recurring_points(obs, solution.motion.rate_hz) if self.options.reidentification.enabled else None,
                float(inliers.mean()),
                alternatives,
                min((h.z for h in rate.harmonics if h.rate_hz > rate.rate_hz), default=np.inf),
                drift,
                constancy(solution, obs, *noise),
                revolutions,
                duration_s,
            ),
            self.options.verdict,
        )
        spin, points = spin_and_points(solution.motion, solution.y, obs.t_ref, changing.middle if changing else span[0])
        estimate = OrbitEstimate(
            status=verdict.status,
            flags=verdict.flags,
            reason=verdict.reason,
            spin=spin,
            rate_std_hz=covariance.rate_std_hz,
            axis_cov=covariance.axis_cov,
            points=points,
            point_rms_px=point_rms(errors, obs),
            point_rows=np.diff(obs.rows.first),
            tracks=int(inliers.sum()),
            observations=len(obs.rows.dt),
            revolutions=revolutions,
            rms_px=float(np.sqrt(np.mean(errors**2))),
            initialisation=start.name,
            rate_slope_hz_s=drift.slope,
            rate_slope_std_hz_s=drift.std,
            t_first=span[0],
            t_last=span[1],
            alternatives=alternatives,
            timing_s=watch.seconds,
        )
        if verdict.status != "failed":
            return estimate
        return OrbitEstimate.failure(
            verdict.reason,
            flags=verdict.flags,
            tracks=estimate.tracks,
            observations=estimate.observations,
            t_first=span[0],
            t_last=span[1],
            alternatives=alternatives,
            timing_s=watch.seconds,
        )


def _alternatives(rate: SpinRate, start: Start) -> tuple[Alternative, ...]:
    found = [
        Alternative("harmonic", h.rate_hz, np.zeros(3), rate.correlation / max(h.correlation, 1e-9))
        for h in rate.harmonics
        if h.correlation > 0.1 * rate.correlation
    ]
    if start.second is not None:
        ratio = start.second.cost / max(start.adjusted.cost, 1e-12)
        mirrored = start.second.motion.axis @ start.adjusted.motion.axis < 0
        found.append(
            Alternative("mirror" if mirrored else "axis", start.second.motion.rate_hz, start.second.motion.axis, ratio)
        )
    return tuple(found)
