"""The back-end: tracks and activity in, orbit out. All behaviour is here; nodes and commands only drive it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from esfo_backend.covariance import motion_covariance
from esfo_backend.direct import mean_direction
from esfo_backend.drift import rate_drift
from esfo_backend.errors import BackendError
from esfo_backend.graph import GraphResult, optimise_graph
from esfo_backend.options import BackendOptions
from esfo_backend.problem import observations, spin_and_points
from esfo_backend.projection import row_errors
from esfo_backend.reidentify import point_rms
from esfo_backend.spin_rate import SpinRate, correlation_rate, fourier_rate
from esfo_backend.start import Start, choose_start
from esfo_backend.structure import Structure, build_structure, prune, recurring_points
from esfo_backend.verdict import Evidence, judge
from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.estimate import Alternative, OrbitEstimate
from esfo_core.options import check
from esfo_core.orbit import NANOSECONDS
from esfo_core.tracks import Tracks, TrackUpdate

LONGEST_GAP_NS = 60_000_000_000
"""A pause in the events after which the earlier ones are left out: nobody knows what the object did meanwhile."""

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
        self._tracks: list[Tracks] = []
        self._activity: list[Activity] = []
        self._lock = threading.Lock()
        self._solved_until: int | None = None
        self._rate_hz: float | None = None

    def add(self, update: TrackUpdate, activity: Activity | None) -> None:
        """Take over what the front-end learnt."""
        with self._lock:
            if len(update.observations):
                self._tracks.append(update.observations)
            if activity is not None and len(activity.counts):
                self._activity.append(activity)

    def counts(self) -> tuple[int, int]:
        """Numbers of track rows and of activity bins received."""
        with self._lock:
            return sum(len(t) for t in self._tracks), sum(len(a.counts) for a in self._activity)

    def due(self) -> bool:
        """True when enough sensor time has passed since the last estimate to make a new one."""
        with self._lock:
            if not self._activity or not self._tracks:
                return False
            begin, end = self._activity[0].t0, self._activity[-1].end
        if self._rate_hz is not None and (end - begin) / NANOSECONDS * self._rate_hz < self.options.live.min_turns:
            return False
        since = begin if self._solved_until is None else self._solved_until
        return end - since >= self.options.live.interval_s * NANOSECONDS

    def update(self, update: TrackUpdate, activity: Activity | None) -> OrbitEstimate | None:
        """`add`, then a quick `solve` if an estimate is due."""
        self.add(update, activity)
        return self.solve(thorough=False) if self.due() else None

    def solve(self, thorough: bool = True) -> OrbitEstimate:
        """Estimate the orbit from everything received so far; never raises for data that do not allow one.

        thorough: try every start that the options ask for; otherwise only the direct one where there is a choice, which
        takes a tenth of the time and is for estimates that the next one replaces.
        """
        with self._lock:
            tracks, pieces = Tracks.concatenate(self._tracks), list(self._activity)
        if not pieces:
            return OrbitEstimate.failure("no events were received")
        stretch = last_stretch(pieces)
        gap = len(stretch) < len(pieces)
        if gap:
            tracks = tracks.select(tracks.t >= stretch[0].t0)
        estimate = self._solve_stretch(tracks, Activity.concatenate(stretch), thorough)
        return replace(estimate, flags=(*estimate.flags, "only_after_gap")) if gap else estimate

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
            return OrbitEstimate.failure(str(error), timing_s=watch.seconds, **known)

    def _solve(self, tracks: Tracks, activity: Activity, watch: _Stopwatch, thorough: bool) -> OrbitEstimate:
        """Paper, section 5: rate, start, factor graph; between them the re-identification of docs/method.md."""
        options = self.options
        with watch.stage("spin_rate"):
            rate = self._spin_rate(activity)
        self._rate_hz = rate.rate_hz
        turns = rate.rate_hz * (activity.end - activity.t0) / NANOSECONDS
        if turns < options.live.min_turns:
            raise BackendError(f"{turns:.2f} turns were seen; {options.live.min_turns} are needed")
        obs, _ = observations(tracks, self.camera, options.start.min_rows)
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
        return self._estimate(structure, result, rate, start, activity, watch)

    def _spin_rate(self, activity: Activity) -> SpinRate:
        if self.options.rate.method == "fourier":
            return SpinRate(fourier_rate(activity, self.options.rate.fourier_window_s), np.nan, np.nan, ())
        return correlation_rate(activity, self.options.rate)

    def _estimate(
        self,
        structure: Structure,
        result: GraphResult,
        rate: SpinRate,
        start: Start,
        activity: Activity,
        watch: _Stopwatch,
    ) -> OrbitEstimate:
        solution, obs, label = structure.solution, structure.obs, structure.label
        covariance = motion_covariance(
            solution, obs, result.marginal, self.options.graph.cauchy_px, self.options.graph.bias_px
        )
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
                rate_drift(solution, obs, self.options.graph.cauchy_px, self.options.graph.bias_px),
                (activity.end - activity.t0) / NANOSECONDS,
            ),
            self.options.verdict,
        )
        spin, points = spin_and_points(solution.motion, solution.y, obs.t_ref, activity.t0)
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
            revolutions=spin.rate_hz * (activity.end - activity.t0) / NANOSECONDS,
            rms_px=float(np.sqrt(np.mean(errors**2))),
            initialisation=start.name,
            t_first=activity.t0,
            t_last=activity.end,
            alternatives=alternatives,
            timing_s=watch.seconds,
        )
        if verdict.status != "failed":
            return estimate
        return OrbitEstimate.failure(
            verdict.reason,
            tracks=estimate.tracks,
            observations=estimate.observations,
            t_first=activity.t0,
            t_last=activity.end,
            alternatives=alternatives,
            timing_s=watch.seconds,
        )


def last_stretch(pieces: list[Activity]) -> list[Activity]:
    """Return the pieces after the last gap of more than `LONGEST_GAP_NS`, in order of time."""
    ordered = sorted(pieces, key=lambda piece: piece.t0)
    gaps = [k for k in range(1, len(ordered)) if ordered[k].t0 - ordered[k - 1].end > LONGEST_GAP_NS]
    return ordered[gaps[-1] :] if gaps else ordered


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
