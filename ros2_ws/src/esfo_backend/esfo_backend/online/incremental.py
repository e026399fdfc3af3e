"""Incremental estimates: the last estimate is updated with new observations, in bounded time.

After a search the motion is accurate enough to associate a new track with its landmark directly. The working set of
tracks is bounded: tracks of landmarks that were observed again, from all times, and the latest and longest others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from esfo_backend.adjustment.bundle_adjustment import bundle_adjustment, linear_points
from esfo_backend.adjustment.covariance import schur_marginal
from esfo_backend.adjustment.factor_graph import GraphOptimum
from esfo_backend.errors import BackendError
from esfo_backend.landmarks.landmarks import Landmarks, prune
from esfo_backend.landmarks.reidentification import Labels, merge_round
from esfo_backend.options import BackendOptions
from esfo_backend.orbit.observations import observations
from esfo_backend.orbit.parametrization import Motion
from esfo_backend.orbit.selection import TrackTable, spread
from esfo_core.camera import Camera
from esfo_core.tracks import Tracks

Ids = NDArray[np.uint32]

_ROWS_PER_TRACK = 32
_SHARE_REOBSERVED = 0.7
_ITERATIONS = 10


class IncrementalSolver:
    """Working set of tracks, the motion, and the landmark of each track.

    motion: None before `begin`. ids, label: (K,) tracks whose landmark is known, ascending, and their landmarks. lost:
    ids of tracks without a landmark. tracks: the working set. camera: the one that the motion is for.
    """

    def __init__(self, camera: Camera, options: BackendOptions) -> None:
        self.motion: Motion | None = None
        self.ids: Ids = np.empty(0, np.uint32)
        self.label: Labels = np.empty(0, np.int64)
        self.lost: Ids = np.empty(0, np.uint32)
        self.tracks = Tracks.empty()
        self.camera, self._options = camera, options

    def begin(self, tracks: Tracks, motion: Motion, ids: Ids, label: Labels, camera: Camera) -> None:
        """Initialise from a search: tracks, motion, the landmark of each track id, -1 for none, and the camera."""
        self.camera = camera
        self.tracks, self.lost = tracks, ids[label < 0]
        self._remember(motion, ids, label)
        self.tracks = self._chosen(tracks)

    @property
    def reobserved(self) -> Ids:
        """Ids of the tracks whose landmark has more than one track."""
        if not len(self.label):
            return self.ids
        return self.ids[np.bincount(self.label)[self.label] > 1]

    def update(self, new_rows: Tracks) -> tuple[Landmarks, GraphOptimum]:
        """Add new observations and update the last estimate.

        Raises BackendError when the tracks no longer follow the motion: a new search is needed.
        """
        if self.motion is None:
            raise BackendError("no search has found a motion yet")
        options = self._options
        self.tracks = self._chosen(Tracks.concatenate([self.tracks, new_rows]))
        obs, ids = observations(self.tracks, self.camera, options.initialisation.min_observations)
        label = self._label_of(ids)
        grouped = obs.regroup(label)
        y = linear_points(self.motion, grouped)
        loose, tight = options.initialisation.cauchy_px, options.graph.cauchy_px
        solution = bundle_adjustment(self.motion, y, grouped, loose, True, _ITERATIONS)
        if options.reidentification.enabled:
            label = merge_round(solution, obs, label, options.reidentification, loose)
            grouped = obs.regroup(label)
            y = linear_points(solution.motion, grouped)
        solution = bundle_adjustment(solution.motion, y, grouped, tight, True, _ITERATIONS)
        landmarks = prune(Landmarks(grouped, solution, label), options)
        solution = landmarks.solution
        self.lost = np.union1d(self.lost, ids[landmarks.label < 0])
        self.lost = np.intersect1d(self.lost, self.tracks.track_id)
        self._remember(solution.motion, ids, landmarks.label)
        return landmarks, GraphOptimum(solution, schur_marginal(solution, landmarks.obs, tight))

    def _remember(self, motion: Motion, ids: Ids, label: Labels) -> None:
        order = np.argsort(ids[label >= 0])
        self.motion, self.ids, self.label = motion, ids[label >= 0][order], label[label >= 0][order]

    def _label_of(self, ids: Ids) -> Labels:
        """Landmark of each track, (M,), consecutive: the known one, or a new one."""
        label = np.arange(len(ids)) + self.label.max(initial=-1) + 1
        known = np.isin(ids, self.ids)
        label[known] = self.label[np.searchsorted(self.ids, ids[known])]
        return np.asarray(np.unique(label, return_inverse=True)[1].astype(np.int64))

    def _chosen(self, tracks: Tracks) -> Tracks:
        """The working set: at most `live.max_tracks` tracks of at most 32 observations."""
        table, limit = TrackTable.of(tracks), self._options.live.max_tracks
        begin, rows = table.begin, table.rows
        again = np.flatnonzero(np.isin(table.ids, self.reobserved))
        kept = again[spread(begin[again], rows[again], np.zeros(len(again), np.int64), int(_SHARE_REOBSERVED * limit))]
        others = np.flatnonzero(~np.isin(table.ids, np.concatenate([table.ids[again], self.lost])))
        # The latest of the others come first: new tracks are needed to observe landmarks again.
        latest = np.argsort(np.argsort(-begin[others], kind="stable")) * 2 // max(limit, 1)
        kept = np.concatenate([kept, others[spread(begin[others], rows[others], latest, limit - len(kept))]])
        return thinned(table.rows_of(tracks, kept), _ROWS_PER_TRACK)


def thinned(tracks: Tracks, limit: int) -> Tracks:
    """At most `limit` rows of each track, evenly spaced, including the first and the last; sorted."""
    ordered = tracks.sorted()
    _, first, count = np.unique(ordered.track_id, return_index=True, return_counts=True)
    place, last = np.arange(len(ordered)) - np.repeat(first, count), np.repeat(np.maximum(count - 1, 1), count)
    part = place * (limit - 1) // last
    before = (place - 1) * (limit - 1) // last
    return ordered.select((part > before) | (place == 0) | (last < limit))
