"""From corners to tracks: by the stages of the paper, or by association with predictions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from esfo_core.events import EventArray, empty_events
from esfo_core.tracks import TrackUpdate
from esfo_frontend.activity import ActivityCounter
from esfo_frontend.association.corner_association import CornerAssociation
from esfo_frontend.clustering.chunk_clusterer import ChunkClusterer, SettledClusters
from esfo_frontend.clustering.cluster_joiner import ClusterJoiner
from esfo_frontend.clustering.density_filter import DensityFilter
from esfo_frontend.clustering.track_windows import TrackWindows
from esfo_frontend.corners.detector import CornerDetector
from esfo_frontend.labelled_corners import NO_LABEL, LabelledCorners
from esfo_frontend.options import FrontendOptions, nanoseconds


@dataclass
class Statistics:
    """Running totals since the front-end was made.

    events taken in; corners: detected and worked on; kept: by the density filter; clustered: given out with a cluster
    or track, not as noise; tracks: begun, with at least one row; rows; windows_dropped: had too few corners;
    uncounted_events: missing in the activity, because they share a bin with the end of an earlier stream.
    speed_px_s: not a total, but the typical speed of the tracks in the image, from association; 0: unknown.
    """

    events: int = 0
    corners: int = 0
    kept: int = 0
    clustered: int = 0
    tracks: int = 0
    rows: int = 0
    windows_dropped: int = 0
    uncounted_events: int = 0
    speed_px_s: float = 0.0


class Parts:
    """Results of the slices that one call has processed."""

    def __init__(self) -> None:
        self.corners: list[LabelledCorners] = []
        self.updates: list[TrackUpdate] = []


@dataclass(frozen=True)
class StreamStart:
    """Where a stream begins.

    size: width and height of the sensor, px. origin: time of the first event, ns. activity_start: of the first bin, ns.
    first_cluster, first_track: first ids to use.
    """

    size: tuple[int, int]
    origin: int
    activity_start: int
    first_cluster: int
    first_track: int


class Pipeline(ABC):
    """The stages with their state, from the first event of a stream to its end.

    The work is done slice by slice. A slice begins and ends at fixed times after the first event; it is worked on once
    the stream is past its end by `reach` ns.
    """

    reach = 0

    def __init__(self, start: StreamStart, options: FrontendOptions, slice_ns: int, statistics: Statistics) -> None:
        width, height = start.size
        self.corners = CornerDetector(width, height, options.corners)
        self.activity = ActivityCounter(width, height, start.activity_start, options.activity)
        self._statistics = statistics
        self._origin, self._slice = start.origin, slice_ns
        self._next_slice = 0

    @property
    @abstractmethod
    def idle(self) -> bool:
        """True when nothing is pending, so that slices without events need no work."""

    @property
    @abstractmethod
    def next_ids(self) -> tuple[int, int]:
        """Ids of the next cluster and of the next track."""

    @abstractmethod
    def finish(self, parts: Parts) -> None:
        """Work on everything that is left."""

    @abstractmethod
    def _take(self, events: EventArray) -> None:
        """Detect corners among events (N,)."""

    @abstractmethod
    def _work(self, end: int, parts: Parts) -> None:
        """Work on the slice that ends at `end` ns."""

    @property
    def _slice_end(self) -> int:
        return self._origin + (self._next_slice + 1) * self._slice

    @property
    def ready(self) -> int:
        """Time in ns of the stream at which the next slice can be worked on."""
        return self._slice_end + self.reach

    def take_in(self, events: EventArray) -> None:
        """Take in events (N,) before `ready`."""
        self._statistics.uncounted_events += self.activity.add(events)
        self._take(events)
        self._statistics.events += len(events)

    def advance(self, t: int, parts: Parts) -> None:
        """Work on all slices that are ready once the stream has reached `t` ns."""
        while t >= self.ready:
            self._next(parts)
            if self.idle:
                # All slices up to t are empty: a long pause takes no time.
                self._next_slice = max(self._next_slice, (t - self.reach - self._origin) // self._slice)

    def _next(self, parts: Parts) -> None:
        self._work(self._slice_end, parts)
        self._next_slice += 1

    def _give(self, corners: LabelledCorners, update: TrackUpdate, parts: Parts) -> None:
        parts.corners.append(corners)
        parts.updates.append(update)
        self._statistics.clustered += int((corners.label != NO_LABEL).sum())
        self._statistics.rows += len(update.observations)


class ClusterPipeline(Pipeline):
    """The paper's stages: density filter, clusters in chunks, joining, window means."""

    def __init__(self, start: StreamStart, options: FrontendOptions, statistics: Statistics) -> None:
        step = nanoseconds(options.clusters.chunk) - nanoseconds(options.clusters.shared)
        super().__init__(start, options, step, statistics)
        scale = options.time_scale
        self._density = DensityFilter(*start.size, scale, options.density)
        self._clusterer = ChunkClusterer(scale, options.clusters, start.first_cluster)
        self._joiner = ClusterJoiner(start.origin, scale, options.join, start.first_track)
        self._windows = TrackWindows(start.origin, options.tracks)
        self.reach = self._density.reach

    @property
    def idle(self) -> bool:
        """As in `Pipeline`."""
        return self._density.idle and self._clusterer.idle and self._joiner.idle

    @property
    def next_ids(self) -> tuple[int, int]:
        """As in `Pipeline`."""
        return self._clusterer.next_id, self._joiner.next_id

    def finish(self, parts: Parts) -> None:
        """As in `Pipeline`."""
        while not self._density.idle:
            self._next(parts)
        self._track(self._clusterer.finish(), parts)
        self.activity.finish()

    def _take(self, events: EventArray) -> None:
        self._density.add(events, self.corners.detect(events))

    def _work(self, end: int, parts: Parts) -> None:
        corners, scored = self._density.filter_until(end)
        self._statistics.corners += scored
        self._statistics.kept += len(corners)
        self._track(self._clusterer.add_slice(corners, end), parts)

    def _track(self, settled: SettledClusters, parts: Parts) -> None:
        dropped, begun = self._windows.dropped, self._windows.begun
        self._give(settled.corners, self._windows.add(self._joiner.add(settled)), parts)
        self._statistics.windows_dropped += self._windows.dropped - dropped
        self._statistics.tracks += self._windows.begun - begun


class AssociationPipeline(Pipeline):
    """Association of all corners with tracks; a track needs several corners, so that no filter precedes it."""

    def __init__(self, start: StreamStart, options: FrontendOptions, statistics: Statistics) -> None:
        super().__init__(start, options, nanoseconds(options.association.slice), statistics)
        width, height = start.size
        self._association = CornerAssociation(width, height, options.association, options.tracks, start.first_track)
        self._first_cluster = start.first_cluster
        self._waiting: list[EventArray] = []

    @property
    def idle(self) -> bool:
        """As in `Pipeline`."""
        return self._association.idle and not any(len(c) for c in self._waiting)

    @property
    def next_ids(self) -> tuple[int, int]:
        """As in `Pipeline`; no cluster is made here."""
        return self._first_cluster, self._association.next_id

    def finish(self, parts: Parts) -> None:
        """As in `Pipeline`."""
        self._work(int(np.iinfo(np.int64).max), parts)
        self.activity.finish()

    def _take(self, events: EventArray) -> None:
        self._waiting.append(events[self.corners.detect(events)])

    def _work(self, end: int, parts: Parts) -> None:
        corners = np.concatenate([empty_events(), *self._waiting])
        self._waiting = []
        before = self._association.next_id
        label, update = self._association.add(corners, end)
        self._statistics.corners += len(corners)
        self._statistics.kept += len(corners)
        self._statistics.tracks += self._association.next_id - before
        self._statistics.speed_px_s = self._association.speed
        self._give(LabelledCorners.from_events(corners, label), update, parts)


PIPELINES: dict[str, type[ClusterPipeline] | type[AssociationPipeline]] = {
    "association": AssociationPipeline,
    "clusters": ClusterPipeline,
}
