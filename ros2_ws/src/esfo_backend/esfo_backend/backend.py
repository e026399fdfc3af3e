"""The back-end: tracks and activity in, orbit out. All behaviour is here; nodes and commands only drive it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from esfo_backend.errors import BackendError
from esfo_backend.online.incremental import IncrementalSolver
from esfo_backend.online.rate_lock import RateLock
from esfo_backend.online.stream_memory import LONGEST_GAP_NS, StreamMemory
from esfo_backend.options import BackendOptions
from esfo_backend.orbit.selection import spread_tracks
from esfo_backend.scale import check_scale, metric
from esfo_backend.search import SearchInput, SearchResult, search
from esfo_backend.state import IncrementalState, load_state, save_state
from esfo_backend.stopwatch import Stopwatch
from esfo_backend.verdict.build_estimate import Optimum, build_estimate
from esfo_core.activity import Activity
from esfo_core.activity_pyramid import ActivityPyramid
from esfo_core.camera import Camera
from esfo_core.estimate import OrbitEstimate
from esfo_core.events import NS_PER_S
from esfo_core.options import check
from esfo_core.tracks import Tracks, TrackUpdate

_SEARCH_TRACKS = 4
"""Tracks that a live search uses, in multiples of those that a live estimate uses."""

_SEARCH_SHARE = 0.05
"""Growth of the stream, of its length, between two searches while nothing is found: searches grow with it."""

_NOT_INCREMENTAL = {"rate_not_constant", "not_a_rotation", "too_few_turns"}
"""Flags of estimates that may come from a wrong rate, or whose rate does not stay."""

OnStage = Callable[[str], None]


@dataclass(frozen=True)
class _Progress:
    """What is known after an estimate.

    solved_until: end of its data, ns. rate_hz: of the event stream. rate_lock: what incremental estimates reuse, None
    where the next one has to search. ramp_searched_s: length of the stream when a rate ramp was last searched.
    """

    solved_until: int | None = None
    rate_hz: float | None = None
    rate_lock: RateLock | None = None
    ramp_searched_s: float = 0.0


class Backend:
    """Accumulates tracks and activity; estimates the orbit from all of them.

    `add` and `due` are cheap and may be called from another thread than `solve`. last_search: result of the latest
    search, None before the first.
    """

    def __init__(self, camera: Camera, options: BackendOptions | None = None) -> None:
        """Raises OptionError for options that are out of range or contradict each other."""
        self.options = options or BackendOptions()
        check(self.options)
        check_scale(self.options.scale)
        self.camera = camera
        self.last_search: SearchResult | None = None
        self._incremental = IncrementalSolver(camera, self.options)
        self._memory = StreamMemory(self.options.memory)
        self._pyramid = ActivityPyramid()
        self._new_rows: list[Tracks] | None = None  # since the last estimate, while the next may be incremental
        self._progress = _Progress()
        self._lock = threading.Lock()  # of the four above, as far as `add` and `due` use them

    def tracks(self) -> Tracks:
        """Return the track rows that are kept, sorted by track, then time."""
        with self._lock:
            return self._memory.tracks().sorted()

    def with_options(self, options: BackendOptions) -> Backend:
        """Return a back-end with other options that goes on with what this one received, from a search.

        This one is not to be used any more. Raises OptionError as the constructor does.
        """
        other = Backend(self.camera, options)
        with self._lock:
            self._memory.limit(options.memory)
            other._memory, other._pyramid = self._memory, self._pyramid
        return other

    def add(self, update: TrackUpdate, activity: Activity | None, pyramid: Sequence[Activity] = ()) -> None:
        """Take over what the front-end learnt. pyramid: pieces of the activity pyramid.

        Raises ActivityError for a piece that is none of a pyramid.
        """
        with self._lock:
            self._memory.add(update, activity)
            self._pyramid.add(pyramid)
            if self._new_rows is not None:
                self._new_rows.append(update.observations)

    def counts(self) -> tuple[int, int]:
        """Numbers of track rows and of activity bins that are kept."""
        with self._lock:
            return self._memory.rows, self._memory.bins

    def due(self) -> bool:
        """True when enough sensor time has passed since the last estimate to make a new one."""
        live = self.options.live
        with self._lock:
            begin, end, progress = self._memory.begin, self._memory.end, self._progress
            if begin is None or end is None or not self._memory.rows:
                return False
        if progress.rate_hz is not None and (end - begin) / NS_PER_S * progress.rate_hz < live.min_revolutions:
            return False
        since = begin if progress.solved_until is None else progress.solved_until
        if progress.rate_lock is not None:
            return end - since >= live.interval_s * NS_PER_S
        return end - since >= max(live.search_s * NS_PER_S, _SEARCH_SHARE * (end - begin))

    def update(
        self, update: TrackUpdate, activity: Activity | None, pyramid: Sequence[Activity] = ()
    ) -> OrbitEstimate | None:
        """`add`, then a quick `solve` if an estimate is due."""
        self.add(update, activity, pyramid)
        return self.solve(thorough=False) if self.due() else None

    def save(self, path: Path) -> None:
        """Write everything that is kept, but the options, to a file; not while `solve` runs.

        Raises StateError when that cannot be done.
        """
        with self._lock:
            lock, until = self._progress.rate_lock, self._progress.solved_until
            state = None
            if lock is not None and until is not None:
                state = IncrementalState(lock, self._incremental, Tracks.concatenate(self._new_rows or []), until)
            save_state(path, self.camera, self._memory, state)

    @staticmethod
    def load(path: Path, options: BackendOptions | None = None) -> Backend:
        """Go on from a saved state. Raises StateError for a file that is none, or of another version."""
        options = options or BackendOptions()
        camera, memory, state = load_state(path, options)
        backend = Backend(camera, options)
        backend._memory = memory
        if state is not None:
            backend._incremental, backend._new_rows = state.incremental, []
            backend._progress = _Progress(state.solved_until, state.rate_lock.rate.rate_hz, state.rate_lock)
        return backend

    def solve(self, thorough: bool = True, on_stage: OnStage = lambda name: None) -> OrbitEstimate:
        """Estimate the orbit from everything received so far; never raises for data that do not allow one.

        thorough: search anew with everything, from every initialisation that the options ask for. Otherwise the last
        estimate is updated where there is one, in bounded work; where there is none, the axis search alone is tried
        where there is a choice, with a bounded number of tracks. on_stage: told the name of each of STAGES as it
        begins.
        """
        estimate = None if thorough else self._update_incrementally(on_stage)
        if estimate is None:
            estimate = self._search(thorough, on_stage)
        with self._lock:
            self._memory.rate_hz = estimate.spin.rate_hz if estimate.spin else self._progress.rate_hz
            self._memory.reobserved = self._incremental.reobserved
        try:
            return metric(estimate, self.options.scale)
        except BackendError as error:
            return OrbitEstimate.failure(str(error), t_first=estimate.t_first, t_last=estimate.t_last)

    def _search(self, thorough: bool, on_stage: OnStage) -> OrbitEstimate:
        with self._lock:
            stream = self._memory.snapshot()
            levels = self._pyramid.levels()
            self._new_rows = []
        if stream is None:
            return OrbitEstimate.failure("no events were received")
        limit = _SEARCH_TRACKS * self.options.live.max_tracks
        tracks = stream.tracks if thorough else spread_tracks(stream.tracks, limit)
        data = SearchInput(tracks, stream.activity, levels, self.camera, self.options, on_stage)
        searched_s = self._progress.ramp_searched_s
        # A ramp takes long: a quick search looks for one when the stream has doubled in length.
        ramp_after_s = 0.0 if thorough or data.duration_s < searched_s else 2 * searched_s
        result = search(data, thorough, ramp_after_s)
        self.last_search = result
        progress = _Progress(
            solved_until=stream.activity.end,
            rate_hz=self._progress.rate_hz if result.rate is None else result.rate.rate_hz,
            rate_lock=self._begin_incremental(result, data),
            ramp_searched_s=data.duration_s if result.ramp_searched else searched_s,
        )
        with self._lock:
            self._progress = progress
            if progress.rate_lock is None:
                self._new_rows = None
        estimate = result.estimate
        if estimate.spin is not None and stream.begin < estimate.t_first:
            revolutions = estimate.spin.rate_hz * (estimate.t_last - stream.begin) / NS_PER_S
            estimate = replace(estimate, t_first=stream.begin, revolutions=revolutions)
        return _with_gap(estimate, stream.after_gap)

    def _begin_incremental(self, result: SearchResult, data: SearchInput) -> RateLock | None:
        """Let incremental estimates start from a search; None where its motion may not be the true one."""
        spin, landmarks, track_ids = result.estimate.spin, result.landmarks, result.track_ids
        if spin is None or landmarks is None or track_ids is None or result.hypothesis.ramp is not None:
            return None
        if result.rate is None or result.initialisation is None or _NOT_INCREMENTAL & set(result.estimate.flags):
            return None
        camera = result.estimate.camera(self.camera)
        self._incremental.begin(data.tracks, landmarks.solution.motion, track_ids, landmarks.label, camera)
        certain = result.estimate.status == "ok" and result.initialisation.certain
        return RateLock(result.rate, result.initialisation, result.rate.rate_hz * data.duration_s, certain)

    def _update_incrementally(self, on_stage: OnStage) -> OrbitEstimate | None:
        """Update the last estimate with the new rows; None where a search has to be made."""
        lock, solved_until = self._progress.rate_lock, self._progress.solved_until
        with self._lock:
            begin, end, after_gap = self._memory.begin, self._memory.end, self._memory.after_gap
            if self._new_rows is None:
                return None
            new_rows, self._new_rows = Tracks.concatenate(self._new_rows), []
        if lock is None or solved_until is None or begin is None or end is None:
            return None
        revolutions = lock.rate.rate_hz * (end - begin) / NS_PER_S
        if end - solved_until > LONGEST_GAP_NS or lock.doubtful(revolutions):
            return None
        watch = Stopwatch(on_stage)
        try:
            if lock.unconfirmed(revolutions):
                lock = self._confirm(lock, revolutions, watch)
            with watch.stage("graph"):
                landmarks, graph = self._incremental.update(new_rows)
            camera = self._incremental.camera
            optimum = Optimum(landmarks, graph, lock.rate, lock.initialisation, (begin, end), camera=camera)
            estimate = build_estimate(optimum, self.options, watch.seconds)
        except BackendError:
            return None
        with self._lock:
            self._progress = replace(self._progress, solved_until=end, rate_lock=lock)
        return None if estimate.spin is None else _with_gap(estimate, after_gap)

    def _confirm(self, lock: RateLock, revolutions: float, watch: Stopwatch) -> RateLock:
        with self._lock:
            stream = self._memory.snapshot()
        if stream is None:
            raise BackendError("no events were received")
        with watch.stage("spin_rate"):
            return lock.confirmed(stream.activity, revolutions, self.options.rate)


def _with_gap(estimate: OrbitEstimate, after_gap: bool) -> OrbitEstimate:
    return replace(estimate, flags=(*estimate.flags, "only_after_gap")) if after_gap else estimate
