"""Feature tracks: mean positions of joined clusters in disjoint windows (section 4.3, equation 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from esfo_core.events import EventArray, empty_events
from esfo_core.tracks import Tracks, TrackUpdate
from esfo_frontend.clustering.cluster_joiner import JoinedCorners
from esfo_frontend.options import TrackOptions, nanoseconds

PRIOR_DEGREES = 4
"""How many degrees of freedom the expected scatter of corners is worth against the scatter measured in a window."""


class TrackWindows:
    """Averages the corners of every track in windows of delta t aligned to the stream's first event.

    A row is the mean pixel position and the mean time of the corners in a window [k delta t, (k + 1) delta t); the
    paper gives it the time k delta t instead, which is biased for windows that a track does not fill.

    sigma^2 = min_sigma^2 + s^2 / n, with n corners and s^2 the variance of a corner about the straight line
    fitted to x and to y over time, so that motion within the window does not count as scatter. s^2 is pooled with
    `corner_sigma`, worth PRIOR_DEGREES degrees of freedom, so that few corners give no chance precision.
    min_sigma stands for what is common to the corners of a window: where on a physical corner they fire.
    """

    def __init__(self, origin: int, options: TrackOptions) -> None:
        self._origin = origin
        self._window = nanoseconds(options.window)
        self._options = options
        self._corners = empty_events()
        self._track_id = np.empty(0, np.int64)
        self._published: set[int] = set()
        self.dropped = 0
        self.begun = 0

    def add(self, joined: JoinedCorners) -> TrackUpdate:
        """Take in new corners and return the rows of the windows that are complete; later rows have later windows."""
        corners = np.concatenate([self._corners, joined.corners])
        track_id = np.concatenate([self._track_id, joined.track_id])
        window = (corners["t"] - self._origin) // self._window
        living, index = np.unique(track_id, return_inverse=True)
        limit = np.array([self._complete_windows(joined, i) for i in living.tolist()], np.int64)
        ready = window < limit[index] if len(living) else np.zeros(0, np.bool_)
        self._corners, self._track_id = corners[~ready], track_id[~ready]
        rows = self._rows(corners[ready], track_id[ready], window[ready])
        seen = set(rows.track_id.tolist())
        self.begun += len(seen - self._published)
        self._published |= seen
        ended = [i for i in joined.ended if i in self._published]
        self._published.difference_update(ended)
        return TrackUpdate(rows, np.array(ended, np.uint32))

    def _complete_windows(self, joined: JoinedCorners, track: int) -> int:
        """Return the number of the first window of `track` that may still change."""
        if track in joined.ended:
            return int(np.iinfo(np.int64).max)
        until = joined.complete_until.get(track)
        return 0 if until is None else (until - self._origin) // self._window

    def _rows(self, corners: EventArray, track_id: NDArray[np.int64], window: NDArray[np.int64]) -> Tracks:
        """Average corners (N,), all of a (track, window) being there; rows ordered by window, then track."""
        order = np.lexsort((corners["t"], track_id, window))
        corners, track_id, window = corners[order], track_id[order], window[order]
        new = np.ones(len(order), np.bool_)
        new[1:] = (track_id[1:] != track_id[:-1]) | (window[1:] != window[:-1])
        first = np.flatnonzero(new)
        start = self._origin + window[first] * self._window
        n, uvt, sigma = self._means(corners, np.cumsum(new) - 1, start)
        enough = n >= self._options.min_corners
        self.dropped += int((~enough).sum())
        t = start + np.rint(uvt[:, 2]).astype(np.int64)
        return Tracks.from_columns(track_id[first], t, uvt[:, :2], sigma).select(enough)

    def _means(
        self, corners: EventArray, group: NDArray[np.int64], start: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Return corners per group (G,), mean x, y and time after the group's `start` (G, 3) and sigma (G,)."""
        n = np.bincount(group, minlength=len(start))

        def total(values: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.bincount(group, values, len(start)).astype(np.float64)

        columns = [corners["x"].astype(np.float64), corners["y"].astype(np.float64)]
        columns.append((corners["t"] - start[group]).astype(np.float64))
        means = [total(c) / n for c in columns]
        x, y, t = (c - mean[group] for c, mean in zip(columns, means, strict=True))
        tt = total(t * t)
        moving = tt > 0
        explained = (total(t * x) ** 2 + total(t * y) ** 2) / np.where(moving, tt, 1.0)
        residual = np.maximum(total(x * x + y * y) - explained, 0.0)
        return n, np.stack(means, axis=1), sigma_of_mean(n, residual, moving, self._options)


def sigma_of_mean(
    n: NDArray[np.int64], residual: NDArray[np.float64], moving: NDArray[np.bool_], options: TrackOptions
) -> NDArray[np.float64]:
    """Return the standard deviation (G,) px of each coordinate of the mean of n (G,) corners, as in `TrackWindows`.

    residual: (G,) sum of the squared distances, px^2, to the line fitted over time. moving: (G,) whether the corners
    are of more than one time, so that a line was fitted.
    """
    degrees = 2 * (n - np.where(moving, 2, 1))
    prior = options.corner_sigma**2
    variance = (PRIOR_DEGREES * prior + residual) / (PRIOR_DEGREES + degrees)
    return np.asarray(np.sqrt(options.min_sigma**2 + variance / n))
