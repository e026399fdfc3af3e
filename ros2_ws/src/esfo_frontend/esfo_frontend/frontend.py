"""The front-end of the paper (ETC): events -> corners -> dense corners -> clusters -> joined clusters -> tracks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esfo_core.activity import Activity
from esfo_core.events import EventArray
from esfo_core.tracks import Tracks, TrackUpdate
from esfo_frontend.activity import LONGEST_FILLED_GAP, ActivityCounter
from esfo_frontend.clusters import NOISE, ChunkClusterer, Clusters, SettledClusters
from esfo_frontend.corners import CornerDetector
from esfo_frontend.density import DensityFilter
from esfo_frontend.errors import FrontendError
from esfo_frontend.joins import ClusterJoiner
from esfo_frontend.options import FrontendOptions, check_options, nanoseconds
from esfo_frontend.tracks import TrackWindows


@dataclass(frozen=True)
class FrontendOutput:
    """What the events of one call settled.

    clusters: corners that passed the density filter, with final cluster ids, in order of time.
    tracks: new rows and the tracks that ended. activity: bins completed, None when there was none.
    """

    clusters: Clusters
    tracks: TrackUpdate
    activity: Activity | None


@dataclass
class Statistics:
    """Running totals since the front-end was made.

    events taken in; corners: scored corner events; kept: by the density filter; clustered: in a cluster, not noise;
    tracks: begun, with at least one row; rows; windows_dropped: had too few corners; uncounted_events: missing in the
    activity, because they share a bin with the end of an earlier stream.
    """

    events: int = 0
    corners: int = 0
    kept: int = 0
    clustered: int = 0
    tracks: int = 0
    rows: int = 0
    windows_dropped: int = 0
    uncounted_events: int = 0


class Frontend:
    """Tracks features in a stream of events.

    The work is done slice by slice, on borders that lie at fixed times after the first event: cutting the stream into
    other packets gives the same rows, bit for bit. A slice is worked on when the stream is past its end by the reach of
    the density filter, so rows come out later than their events by up to a chunk and a window.
    """

    def __init__(self, width: int, height: int, options: FrontendOptions = FrontendOptions()) -> None:  # noqa: B008
        """Prepare for a sensor of width x height px. Raises OptionError for impossible options."""
        check_options(options)
        self._size, self._options = (int(width), int(height)), options
        self._stream: _Stream | None = None
        self._next_cluster = self._next_track = 0
        self._last_t: int | None = None
        self._activity_origin = self._activity_end = 0
        self.statistics = Statistics()

    def process(self, events: EventArray) -> FrontendOutput:
        """Take in events (N,), time-sorted and following earlier ones; return what they settle.

        Raises FrontendError, without taking anything in, when an event is earlier than the one before it, outside of
        the sensor or of a polarity other than 0 and 1, or when one call has two pauses of more than a minute.
        """
        self._check(events)
        parts = _Parts()
        while len(events):
            stream = self._stream or self._begin(int(events["t"][0]))
            stream.advance(int(events["t"][0]), parts)
            n = int(np.searchsorted(events["t"], stream.ready))
            stream.take_in(events[:n])
            self._last_t = int(events["t"][n - 1])
            events = events[n:]
        return self._output(parts)

    def flush(self) -> FrontendOutput:
        """End the stream: settle everything pending and end every track.

        Later events begin a new stream, at any time; ids of clusters and tracks go on.
        """
        parts = _Parts()
        stream = self._stream
        if stream is None:
            return self._output(parts)
        stream.finish(parts)
        output = self._output(parts)
        self._stream = None
        self._next_cluster, self._next_track = stream.clusterer.next_id, stream.joiner.next_id
        self._activity_end = stream.activity.end
        return output

    def _begin(self, t: int) -> _Stream:
        """Start a stream at `t` ns, with activity bins on the grid of the earlier stream unless time went back."""
        if self._last_t is None or t < self._last_t:
            self._activity_origin = activity_start = t
        else:
            step = nanoseconds(self._options.activity.bin)
            activity_start = max(t - (t - self._activity_origin) % step, self._activity_end)
        self._stream = _Stream(self._size, self._options, t, activity_start, self.statistics)
        self._stream.clusterer.next_id, self._stream.joiner.next_id = self._next_cluster, self._next_track
        return self._stream

    def _check(self, events: EventArray) -> None:
        if not len(events):
            return
        t = events["t"]
        step = np.diff(t)
        if self._stream is not None and self._last_t is not None:
            step = np.concatenate([[t[0] - self._last_t], step])
        if len(step) and step.min() < 0:
            raise FrontendError(f"time goes back by {-int(step.min())} ns: events are not sorted")
        if (step > LONGEST_FILLED_GAP).sum() > 1:
            raise FrontendError(
                f"two pauses of more than {LONGEST_FILLED_GAP / 1e9:.0f} s in one packet: clock errors?"
            )
        width, height = self._size
        if events["x"].max() >= width or events["y"].max() >= height:
            bad = int(np.argmax((events["x"] >= width) | (events["y"] >= height)))
            x, y = events["x"][bad], events["y"][bad]
            raise FrontendError(f"event at pixel ({x}, {y}) is outside of the {width}x{height} sensor")
        if events["p"].min() < 0 or events["p"].max() > 1:
            bad = int(np.argmax((events["p"] < 0) | (events["p"] > 1)))
            raise FrontendError(f"event polarity {events['p'][bad]} is neither 0 nor 1")

    def _output(self, parts: _Parts) -> FrontendOutput:
        activity = self._stream.activity.take() if self._stream else None
        observations = Tracks.concatenate(u.observations for u in parts.updates)
        ended = np.sort(np.concatenate([np.empty(0, np.uint32), *(u.ended for u in parts.updates)]))
        return FrontendOutput(Clusters.concatenate(parts.clusters), TrackUpdate(observations, ended), activity)


class _Parts:
    """Results of the slices worked on in one call."""

    def __init__(self) -> None:
        self.clusters: list[Clusters] = []
        self.updates: list[TrackUpdate] = []


class _Stream:
    """The stages with their state, from the first event of a stream to its end."""

    def __init__(
        self, size: tuple[int, int], options: FrontendOptions, origin: int, activity_start: int, statistics: Statistics
    ) -> None:
        width, height = size
        scale = options.time_scale
        self.corners = CornerDetector(width, height, options.corners)
        self.density = DensityFilter(width, height, scale, options.density)
        self.clusterer = ChunkClusterer(scale, options.clusters)
        self.joiner = ClusterJoiner(origin, scale, options.join)
        self.windows = TrackWindows(origin, options.tracks)
        self.activity = ActivityCounter(width, height, activity_start, options.activity)
        self._statistics = statistics
        self._origin = origin
        self._slice = nanoseconds(options.clusters.chunk) - nanoseconds(options.clusters.shared)
        self._next_slice = 0

    @property
    def _slice_end(self) -> int:
        return self._origin + (self._next_slice + 1) * self._slice

    @property
    def ready(self) -> int:
        """Time in ns of the stream at which the next slice can be worked on."""
        return self._slice_end + self.density.reach

    def take_in(self, events: EventArray) -> None:
        """Detect corners among events (N,) before `ready`."""
        self._statistics.uncounted_events += self.activity.add(events)
        self.density.add(events, self.corners.detect(events))
        self._statistics.events += len(events)

    def advance(self, t: int, parts: _Parts) -> None:
        """Work on all slices that are ready once the stream has reached `t` ns."""
        while t >= self.ready:
            self._work(parts)
            if self.density.idle and self.clusterer.idle and self.joiner.idle:
                # Nothing but empty slices up to t: a long pause costs no time.
                self._next_slice = max(self._next_slice, (t - self.density.reach - self._origin) // self._slice)

    def finish(self, parts: _Parts) -> None:
        """Work on everything that is left."""
        while not self.density.idle:
            self._work(parts)
        self._track(self.clusterer.finish(), parts)
        self.activity.finish()

    def _work(self, parts: _Parts) -> None:
        corners, scored = self.density.filter_until(self._slice_end)
        self._statistics.corners += scored
        self._statistics.kept += len(corners)
        self._track(self.clusterer.add_slice(corners, self._slice_end), parts)
        self._next_slice += 1

    def _track(self, settled: SettledClusters, parts: _Parts) -> None:
        dropped, begun = self.windows.dropped, self.windows.begun
        update = self.windows.add(self.joiner.add(settled))
        parts.clusters.append(settled.clusters)
        parts.updates.append(update)
        self._statistics.clustered += int((settled.clusters.cluster_id != NOISE).sum())
        self._statistics.rows += len(update.observations)
        self._statistics.windows_dropped += self.windows.dropped - dropped
        self._statistics.tracks += self.windows.begun - begun
