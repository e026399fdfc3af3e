"""The back-end: tracks and activity in, orbit out. All behaviour is here; nodes and commands only drive it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from esfo_backend.errors import BackendError
from esfo_backend.initialise.initialisation import Initialisation
from esfo_backend.online.incremental import IncrementalSolver
from esfo_backend.online.rate_lock import RateLock
from esfo_backend.online.stream_memory import LONGEST_GAP_NS, StreamMemory
from esfo_backend.options import BackendOptions
from esfo_backend.orbit.selection import spread_tracks
from esfo_backend.scale import check_scale, metric
from esfo_backend.search import Solver
from esfo_backend.state import IncrementalState, load_state, save_state
from esfo_backend.stopwatch import Stopwatch
from esfo_backend.verdict.build_estimate import Optimum, build_estimate
from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.estimate import OrbitEstimate
from esfo_core.options import check
from esfo_core.orbit import NS_PER_S
from esfo_core.tracks import Tracks, TrackUpdate

_SEARCH_TRACKS = 4
"""Tracks that a live search uses, in multiples of those that a live estimate uses."""

_SEARCH_SHARE = 0.05
"""Growth of the stream, of its length, between two searches while nothing is found: searches grow with it."""

_NOTHING_TO_FOLLOW = {"rate_not_constant", "not_a_rotation", "too_few_turns"}
"""Flags of estimates that may come from a wrong rate, or whose rate does not stay."""


class Backend:
    """Accumulates tracks and activity; estimates the orbit from all of them.

    `add` and `due` are cheap and may be called from another thread than `solve`.
    """

    def __init__(self, camera: Camera, options: BackendOptions | None = None) -> None:
        self.options = options or BackendOptions()
        check(self.options)
        check_scale(self.options.scale)
        self.camera = camera
        self._solver = Solver(camera, self.options)
        self._incremental = IncrementalSolver(camera, self.options)
        self._memory = StreamMemory(self.options.memory)
        self._news: list[Tracks] = []  # since the last estimate, while there may be one that goes on
        self._goes_on = False
        self._basis: RateLock | None = None  # of estimates that go on
        self._lock = threading.Lock()
        self._solved_until: int | None = None

    @property
    def last_initialisation(self) -> Initialisation | None:
        """Initial values of the last search."""
        return self._solver.last_initialisation

    @property
    def last_initialisation_note(self) -> str:
        """What became of COLMAP in the last search."""
        return "" if self.last_initialisation is None else self.last_initialisation.colmap_note

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
            other._memory = self._memory
        return other

    def tell_stages(self, on_stage: Callable[[str], None]) -> None:
        """Have `on_stage` called with the name of each of STAGES as it begins."""
        self._solver.on_stage = on_stage

    def add(self, update: TrackUpdate, activity: Activity | None) -> None:
        """Take over what the front-end learnt."""
        with self._lock:
            self._memory.add(update, activity)
            if self._goes_on:
                self._news.append(update.observations)

    def counts(self) -> tuple[int, int]:
        """Numbers of track rows and of activity bins that are kept."""
        with self._lock:
            return self._memory.rows, self._memory.bins

    def due(self) -> bool:
        """True when enough sensor time has passed since the last estimate to make a new one."""
        live = self.options.live
        with self._lock:
            begin, end = self._memory.begin, self._memory.end
            if begin is None or end is None or not self._memory.rows:
                return False
        if self._solver.rate_hz is not None and (end - begin) / NS_PER_S * self._solver.rate_hz < live.min_revolutions:
            return False
        since = begin if self._solved_until is None else self._solved_until
        if self._basis is not None:
            return end - since >= live.interval_s * NS_PER_S
        return end - since >= max(live.search_s * NS_PER_S, _SEARCH_SHARE * (end - begin))

    def update(self, update: TrackUpdate, activity: Activity | None) -> OrbitEstimate | None:
        """`add`, then a quick `solve` if an estimate is due."""
        self.add(update, activity)
        return self.solve(thorough=False) if self.due() else None

    def save(self, path: Path) -> None:
        """Write everything that is kept, but the options, to a file; not while `solve` runs.

        Raises StateError when that cannot be done.
        """
        with self._lock:
            following = None
            if self._basis is not None and self._solved_until is not None:
                news = Tracks.concatenate(self._news)
                following = IncrementalState(self._basis, self._incremental, news, self._solved_until)
            save_state(path, self.camera, self._memory, following)

    @staticmethod
    def load(path: Path, options: BackendOptions | None = None) -> Backend:
        """Go on from a saved state. Raises StateError for a file that is none, or of another version."""
        options = options or BackendOptions()
        camera, history, following = load_state(path, options)
        backend = Backend(camera, options)
        backend._memory = history
        if following is not None:
            backend._basis, backend._incremental = following.rate_lock, following.incremental
            backend._solved_until, backend._goes_on = following.solved_until, True
            backend._solver.rate_hz = following.rate_lock.rate.rate_hz
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
            self._memory.rate_hz = estimate.spin.rate_hz if estimate.spin else self._solver.rate_hz
            self._memory.recurring = self._incremental.recurring
        try:
            return metric(estimate, self.options.scale)
        except BackendError as error:
            return OrbitEstimate.failure(str(error), t_first=estimate.t_first, t_last=estimate.t_last)

    def _search(self, thorough: bool) -> OrbitEstimate:
        with self._lock:
            seen = self._memory.seen()
            self._news, self._goes_on = [], True
        if seen is None:
            return OrbitEstimate.failure("no events were received")
        tracks = seen.tracks if thorough else spread_tracks(seen.tracks, _SEARCH_TRACKS * self.options.live.max_tracks)
        estimate = self._solver.search(tracks, seen.activity, thorough)
        self._solved_until = seen.activity.end
        found = self._solver.found
        if found is None or estimate.spin is None or _NOTHING_TO_FOLLOW & set(estimate.flags):
            self._stop_following()
        else:
            certain = estimate.status == "ok" and found.initialisation.certain
            self._basis = RateLock(found.rate, found.initialisation, found.turns, certain)
            self._incremental.begin(tracks, found.landmarks.solution.motion, found.ids, found.landmarks.label)
        if estimate.spin is not None and seen.begin < estimate.t_first:
            turns = estimate.spin.rate_hz * (estimate.t_last - seen.begin) / NS_PER_S
            estimate = replace(estimate, t_first=seen.begin, revolutions=turns)
        return replace(estimate, flags=(*estimate.flags, "only_after_gap")) if seen.after_gap else estimate

    def _stop_following(self) -> None:
        with self._lock:
            self._basis, self._news, self._goes_on = None, [], False

    def _follow(self) -> OrbitEstimate | None:
        """Go on from the last estimate; None where a search has to be made."""
        rate_lock = self._basis
        with self._lock:
            begin, end, after_gap = self._memory.begin, self._memory.end, self._memory.after_gap
            news, self._news = Tracks.concatenate(self._news), []
        if rate_lock is None or self._solved_until is None or begin is None or end is None:
            return None
        turns = rate_lock.rate.rate_hz * (end - begin) / NS_PER_S
        if end - self._solved_until > LONGEST_GAP_NS or rate_lock.doubtful(turns):
            return None
        watch = Stopwatch(self._solver.on_stage)
        try:
            if rate_lock.unconfirmed(turns):
                rate_lock = self._basis = self._confirmed(rate_lock, turns, watch)
            with watch.stage("graph"):
                landmarks, result = self._incremental.update(news)
            optimum = Optimum(landmarks, result, rate_lock.rate, rate_lock.initialisation, (begin, end))
            estimate = build_estimate(optimum, self.options, watch.seconds)
        except BackendError:
            return None
        self._solved_until = end
        if estimate.spin is None:
            return None
        return replace(estimate, flags=(*estimate.flags, "only_after_gap")) if after_gap else estimate

    def _confirmed(self, rate_lock: RateLock, turns: float, watch: Stopwatch) -> RateLock:
        with self._lock:
            seen = self._memory.seen()
        if seen is None:
            raise BackendError("no events were received")
        with watch.stage("spin_rate"):
            return rate_lock.confirmed(seen.activity, turns, self.options.rate)
