"""Live estimates after the first: the last one goes on with the new rows, in bounded work whatever came before.

A search looks at everything once; after it the motion is known well enough to tell at once which point a new track
belongs to. The tracks that take part are a bounded set: those of points that came round again, from all times, and of
the others the latest and longest.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from esfo_backend.adjustment.bundle_adjustment import bundle_adjustment, linear_points, schur_marginal
from esfo_backend.adjustment.factor_graph import GraphOptimum
from esfo_backend.errors import BackendError
from esfo_backend.landmarks.landmarks import Landmarks, prune
from esfo_backend.landmarks.reidentification import Labels, merge_round
from esfo_backend.options import BackendOptions
from esfo_backend.orbit.parametrization import Motion, observations
from esfo_backend.orbit.selection import spread
from esfo_core.camera import Camera
from esfo_core.tracks import Tracks

Ids = NDArray[np.uint32]

_ROWS_PER_TRACK = 32
_SHARE_RECURRING = 0.7
_ITERATIONS = 10


class IncrementalSolver:
    """Working set of tracks, the motion, and which point each track belongs to.

    ids, label: (K,) tracks whose point is known, ascending, and their points. lost: tracks that follow no point.
    """

    def __init__(self, camera: Camera, options: BackendOptions) -> None:
        self.motion: Motion | None = None
        self.ids: Ids = np.empty(0, np.uint32)
        self.label: Labels = np.empty(0, np.int64)
        self._lost: Ids = np.empty(0, np.uint32)
        self._camera, self._options = camera, options
        self._tracks = Tracks.empty()

    def begin(self, tracks: Tracks, motion: Motion, ids: Ids, label: Labels) -> None:
        """Start from what a search found: tracks, the motion, and the point of each track id, -1 for none."""
        self._tracks, self._lost = tracks, ids[label < 0]
        self._remember(motion, ids, label)
        self._tracks = self._chosen(tracks)

    def arrays(self, news: Tracks) -> dict[str, ArrayLike]:
        """Return what an update starts from as arrays for a file. news: rows that wait for the next update."""
        if self.motion is None:
            return {}
        tracks = Tracks.concatenate([self._tracks, news])
        return {
            "followed_Q": self.motion.Q,
            "followed_rate_hz": self.motion.rate_hz,
            "followed_ids": self.ids,
            "followed_label": self.label,
            "followed_lost": self._lost,
            "followed_track_id": tracks.track_id,
            "followed_t": tracks.t,
            "followed_uv": tracks.uv,
            "followed_sigma": tracks.sigma,
        }

    def restore(self, arrays: Mapping[str, NDArray[np.generic]]) -> None:
        """Go on from what `arrays` gave. Raises KeyError or ValueError for anything else."""
        Q = np.asarray(arrays["followed_Q"], np.float64).reshape(3, 3)
        self.motion = Motion(Q, float(np.asarray(arrays["followed_rate_hz"], np.float64)))
        self.ids = np.asarray(arrays["followed_ids"], np.uint32)
        self.label = np.asarray(arrays["followed_label"], np.int64)
        self._lost = np.asarray(arrays["followed_lost"], np.uint32)
        self._tracks = Tracks.from_columns(*(arrays[f"followed_{name}"] for name in ("track_id", "t", "uv", "sigma")))

    @property
    def recurring(self) -> Ids:
        """Ids of the tracks whose point has more than one."""
        if not len(self.label):
            return self.ids
        return self.ids[np.bincount(self.label)[self.label] > 1]

    def update(self, news: Tracks) -> tuple[Landmarks, GraphOptimum]:
        """Take in new rows and go on from the last estimate.

        Raises BackendError when the tracks do not follow the motion any more: a search has to begin anew.
        """
        if self.motion is None:
            raise BackendError("nothing was found yet that could be followed")
        options = self._options
        self._tracks = self._chosen(Tracks.concatenate([self._tracks, news]))
        obs, ids = observations(self._tracks, self._camera, options.initialisation.min_observations)
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
        self._lost = np.union1d(self._lost, ids[landmarks.label < 0])
        self._lost = np.intersect1d(self._lost, self._tracks.track_id)
        self._remember(solution.motion, ids, landmarks.label)
        return landmarks, GraphOptimum(solution, schur_marginal(solution, landmarks.obs, tight))

    def _remember(self, motion: Motion, ids: Ids, label: Labels) -> None:
        order = np.argsort(ids[label >= 0])
        self.motion, self.ids, self.label = motion, ids[label >= 0][order], label[label >= 0][order]

    def _label_of(self, ids: Ids) -> Labels:
        """Point of each track: the known one, or one of its own; consecutive."""
        label = np.arange(len(ids)) + self.label.max(initial=-1) + 1
        known = np.isin(ids, self.ids)
        label[known] = self.label[np.searchsorted(self.ids, ids[known])]
        return np.asarray(np.unique(label, return_inverse=True)[1].astype(np.int64))

    def _chosen(self, tracks: Tracks) -> Tracks:
        """The tracks that take part: at most `live.max_tracks`, of 32 rows each."""
        ids, index, rows = np.unique(tracks.track_id, return_inverse=True, return_counts=True)
        begin = np.full(len(ids), np.iinfo(np.int64).max)
        np.minimum.at(begin, index, tracks.t)
        limit = self._options.live.max_tracks
        again = np.flatnonzero(np.isin(ids, self.recurring))
        kept = again[spread(begin[again], rows[again], np.zeros(len(again), np.int64), int(_SHARE_RECURRING * limit))]
        others = np.flatnonzero(~np.isin(ids, np.concatenate([ids[again], self._lost])))
        # The latest half of the rest first: what is new has to be met, or nothing would come round again.
        latest = np.argsort(np.argsort(-begin[others], kind="stable")) * 2 // max(limit, 1)
        kept = np.concatenate([kept, others[spread(begin[others], rows[others], latest, limit - len(kept))]])
        chosen = np.zeros(len(ids), bool)
        chosen[kept] = True
        return thinned(tracks.select(chosen[index]), _ROWS_PER_TRACK)


def thinned(tracks: Tracks, limit: int) -> Tracks:
    """At most `limit` rows of each track, evenly spread, the first and the last among them; sorted."""
    ordered = tracks.sorted()
    _, first, count = np.unique(ordered.track_id, return_index=True, return_counts=True)
    place, last = np.arange(len(ordered)) - np.repeat(first, count), np.repeat(np.maximum(count - 1, 1), count)
    part = place * (limit - 1) // last
    before = (place - 1) * (limit - 1) // last
    return ordered.select((part > before) | (place == 0) | (last < limit))
