"""Activity and tracks of a stream, in bounded memory.

Activity: the latest bins when they cover enough revolutions for the period, otherwise coarser bins of the whole time.
Tracks: the longest of each time interval, those of landmarks that were observed again first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from esfo_backend.options import MemoryOptions
from esfo_backend.orbit.selection import TrackTable, spread
from esfo_core.activity import Activity, ActivityError
from esfo_core.events import NS_PER_S
from esfo_core.tracks import Tracks, TrackUpdate

LONGEST_GAP_NS = 60_000_000_000
"""Pause in the events after which the earlier ones are left out: the motion during the pause is unknown."""

_KEPT = 0.75
"""Share that is kept when a limit is exceeded, so that the limit is not exceeded again at once."""


@dataclass(frozen=True)
class StreamSnapshot:
    """Data of an estimate.

    activity: of the latest time, possibly in coarser bins than received. begin: time of the first event, ns, which may
    be earlier. after_gap: whether data before a long pause were left out.
    """

    tracks: Tracks
    activity: Activity
    begin: int
    after_gap: bool


class StreamMemory:
    """Tracks and activity since the start of the stream or the last long pause.

    rate_hz: the latest estimate, None while unknown. reobserved: ids of tracks of landmarks that were observed again.
    Both only decide what is dropped. begin: time of the first event, ns. after_gap: whether a long pause precedes it.
    coarse: activity of the past, in bins of `factor` bins of the stream. Not safe for use from several threads.
    """

    def __init__(self, options: MemoryOptions) -> None:
        self.rate_hz: float | None = None
        self.reobserved: NDArray[np.uint32] = np.empty(0, np.uint32)
        self.begin: int | None = None
        self.after_gap = False
        self.coarse: Activity | None = None
        self.factor = 1
        self._options = options
        self._recent: list[Activity] = []
        self._tracks: list[Tracks] = []
        self._rows = self._bins = 0
        self._error: ActivityError | None = None

    def limit(self, options: MemoryOptions) -> None:
        """Use other limits from the next `add` on."""
        self._options = options

    @property
    def rows(self) -> int:
        """Number of rows of tracks that are kept."""
        return self._rows

    @property
    def bins(self) -> int:
        """Number of bins of activity that are kept."""
        return self._bins

    @property
    def end(self) -> int | None:
        """Time just after the last bin, ns; None before the first."""
        if self._recent:
            return self._recent[-1].end
        return None if self.coarse is None else self.coarse.end

    def add(self, update: TrackUpdate, activity: Activity | None) -> None:
        """Add tracks and activity, and drop data beyond the limits."""
        if len(update.observations):
            self._tracks.append(update.observations)
            self._rows += len(update.observations)
        if activity is not None and len(activity.counts):
            self.begin = activity.t0 if self.begin is None else min(self.begin, activity.t0)
            self._recent.append(activity)
            self._bins += len(activity.counts)
        if self._bins > self._options.max_bins:
            try:
                self._forget_activity()
            except ActivityError as error:  # raised by `snapshot`, so that the estimate has it as its reason
                self._error, self._recent = error, []
                self._count_bins()
        if self._rows > self._options.max_observations:
            self._forget_tracks()

    def restore(self, begin: int | None, after_gap: bool, coarse: Activity | None, factor: int) -> None:
        """Restore a saved memory; its recent activity and its tracks are added by `add`."""
        self.begin, self.after_gap, self.coarse, self.factor = begin, after_gap, coarse, factor
        self._count_bins()

    def recent(self) -> Activity | None:
        """Return the activity that is not in `coarse` yet. Raises ActivityError when its pieces are incompatible."""
        return Activity.concatenate(self._recent) if self._recent else None

    def tracks(self) -> Tracks:
        """Return all rows that are kept, in the order received."""
        return Tracks.concatenate(self._tracks)

    def snapshot(self) -> StreamSnapshot | None:
        """Return everything that is kept, None before the first event. Raises ActivityError for pieces that overlap."""
        if self._error is not None:
            raise self._error
        self._drop_before_gap()
        whole = self._whole()
        if whole is None or self.begin is None:
            return None
        tracks = self.tracks()
        if self.after_gap:
            tracks = tracks.select(tracks.t >= self.begin)
        return StreamSnapshot(tracks, whole, self.begin, self.after_gap)

    def _drop_before_gap(self) -> None:
        end, kept = None if self.coarse is None else self.coarse.end, list[Activity]()
        for piece in sorted(self._recent, key=lambda piece: piece.t0):
            if end is not None and piece.t0 - end > LONGEST_GAP_NS:
                kept, self.coarse, self.factor = [], None, 1
                self.begin, self.after_gap = piece.t0, True
            kept.append(piece)
            end = piece.end
        self._recent = kept
        self._count_bins()

    def _count_bins(self) -> None:
        old = 0 if self.coarse is None else len(self.coarse.counts)
        self._bins = old + sum(len(piece.counts) for piece in self._recent)

    def _whole(self) -> Activity | None:
        recent = self.recent()
        if self.coarse is None or recent is None:
            return self.coarse or recent
        nothing = np.zeros((1, *recent.counts.shape[1:]), np.uint16)
        gap = Activity(self.coarse.end, recent.bin, recent.cell, nothing, np.zeros(1, np.bool_))
        pieces = [gap, recent] if recent.t0 > self.coarse.end else [recent]
        return Activity.concatenate([self.coarse, coarser(Activity.concatenate(pieces), self.factor)])

    def _forget_activity(self) -> None:
        """Keep the latest bins if they cover enough revolutions at a known rate, otherwise make all bins coarser."""
        self._drop_before_gap()
        kept, recent, limit = self._whole(), self.recent(), round(_KEPT * self._options.max_bins)
        if kept is None or recent is None or self._bins <= self._options.max_bins:
            return
        if len(kept.counts) > limit:
            seconds = limit * kept.bin / NS_PER_S
            if self.rate_hz is not None and seconds * self.rate_hz >= self._options.revolutions:
                kept = _copy(kept.part(len(kept.counts) - limit))
            else:
                kept, self.factor = coarser(kept, 2), 2 * self.factor
        used = max((kept.end - recent.t0) // recent.bin, 0)  # the last bins may not fill a coarse one yet
        left = _copy(recent.part(used))
        self.coarse, self._recent = kept, [left] if len(left.counts) else []
        self._count_bins()

    def _forget_tracks(self) -> None:
        tracks = self.tracks()
        table = TrackTable.of(tracks)
        rank = np.where(np.isin(table.ids, self.reobserved), 0, 1)
        count = len(table.ids)
        while True:
            count = int(_KEPT * count)
            chosen = spread(table.begin, table.rows, rank, count)
            if table.rows[chosen].sum() <= _KEPT * self._options.max_observations:
                break
        tracks = table.rows_of(tracks, chosen)
        self._tracks, self._rows = [tracks], len(tracks)


def coarser(activity: Activity, factor: int) -> Activity:
    """Add up groups of `factor` bins; bins at the end that fill no group are left out.

    A group is missing where half or more of its bins are.
    """
    bins = len(activity.counts) // factor
    groups = activity.counts[: bins * factor].reshape(bins, factor, *activity.counts.shape[1:])
    counts = np.minimum(groups.sum(axis=1, dtype=np.uint32), np.iinfo(np.uint16).max).astype(np.uint16)
    valid = activity.valid[: bins * factor].reshape(bins, factor).mean(axis=1) > 0.5
    return Activity(activity.t0, activity.bin * factor, activity.cell, counts, valid)


def _copy(activity: Activity) -> Activity:
    """Free of the larger arrays of which it is a part."""
    return replace(activity, counts=activity.counts.copy(), valid=activity.valid.copy())
