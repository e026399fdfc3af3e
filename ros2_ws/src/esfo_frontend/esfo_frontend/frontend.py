"""The front-end: events -> corners -> tracks, by the stages of the paper (ETC) or by association."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from esfo_core.activity import Activity
from esfo_core.camera import HasSize
from esfo_core.events import NS_PER_S, EventArray, empty_events
from esfo_core.pyramid_counter import PyramidCounter
from esfo_core.tracks import Tracks, TrackUpdate
from esfo_frontend.activity import LONGEST_FILLED_GAP
from esfo_frontend.errors import FrontendError
from esfo_frontend.labelled_corners import LabelledCorners
from esfo_frontend.options import FrontendOptions, check_for_sensor, nanoseconds
from esfo_frontend.trackers import PIPELINES, Parts, Pipeline, Statistics, StreamStart


@dataclass(frozen=True)
class FrontendOutput:
    """Corners, tracks and activity that the events of one call settled.

    corners: in order of time. With the paper's stages, those that passed the density filter, with their final clusters;
    with association all corners, with their tracks, NO_LABEL as long as a track has no row.
    tracks: new rows and the tracks that ended. activity: bins completed, None when there was none. pyramid: pieces of
    the activity pyramid, of several resolutions.
    """

    corners: LabelledCorners
    tracks: TrackUpdate
    activity: Activity | None
    pyramid: tuple[Activity, ...] = ()


class Frontend:
    """Tracks features in a stream of events.

    The work is done slice by slice, on borders that lie at fixed times after the first event: cutting the stream into
    other packets gives the same rows, bit for bit. A slice is worked on when the stream is past its end, with the
    paper's stages by the reach of the density filter. There rows come out later than their events by up to a chunk and
    a window, with association by a slice of some milliseconds.
    """

    def __init__(
        self,
        sensor: HasSize,
        options: FrontendOptions | None = None,
        first_ids: tuple[int, int] = (0, 0),
    ) -> None:
        """Prepare for the events of a sensor.

        sensor: its camera, a recording of it, or its `SensorSize` alone. first_ids: ids of the first cluster and track.

        Raises OptionError for options that are impossible, or for this sensor.
        """
        self._size = (int(sensor.width), int(sensor.height))
        self._options = options or FrontendOptions()
        check_for_sensor(self._options, *self._size)
        self._stream: Pipeline | None = None
        self._next_ids = first_ids
        self._last_t: int | None = None
        self._activity_origin = self._activity_end = 0
        self._activity_options = self._options.activity
        self._pyramid: PyramidCounter | None = None
        self.statistics = Statistics()

    @property
    def next_ids(self) -> tuple[int, int]:
        """Ids of the next cluster and of the next track."""
        return self._next_ids if self._stream is None else self._stream.next_ids

    def configure(self, options: FrontendOptions) -> None:
        """Use other options from the next stream on, which `flush` begins.

        Raises OptionError for options that are impossible, or for this sensor.
        """
        check_for_sensor(options, *self._size)
        self._options = options

    def process(self, events: EventArray) -> FrontendOutput:
        """Take in events (N,), time-sorted and following earlier ones; return what they settle.

        Raises FrontendError, without taking anything in, when an event is earlier than the one before it, outside of
        the sensor or of a polarity other than 0 and 1, or when one call has two pauses of more than a minute.
        """
        self._check(events)
        parts = Parts()
        while len(events):
            stream = self._stream or self._begin(int(events["t"][0]))
            stream.advance(int(events["t"][0]), parts)
            n = int(np.searchsorted(events["t"], stream.ready))
            stream.take_in(events[:n])
            self._count(events[:n])
            self._last_t = int(events["t"][n - 1])
            events = events[n:]
        return self._output(parts)

    def run(self, chunks: Iterable[EventArray]) -> Iterator[tuple[EventArray, FrontendOutput]]:
        """Process a whole stream, chunk by chunk, and end it.

        Yields each chunk with what it settles, then an empty one with what was pending. Raises FrontendError as
        `process`.
        """
        for events in chunks:
            yield events, self.process(events)
        yield empty_events(), self.flush()

    def miss(self, begin: int, end: int) -> None:
        """Note that events of [begin, end) ns are missing; told after the events before it, before those after it."""
        if self._pyramid is not None:
            self._pyramid.miss(begin, end)

    def flush(self) -> FrontendOutput:
        """End the stream: settle everything pending and end every track.

        Later events begin a new stream, at any time; ids of clusters and tracks continue.
        """
        parts = Parts()
        stream = self._stream
        if stream is None:
            return self._output(parts)
        stream.finish(parts)
        if self._pyramid is not None:
            self._pyramid.finish()
        output = self._output(parts)
        self._stream = None
        self._next_ids = stream.next_ids
        self._activity_end = stream.activity.end
        return output

    def _begin(self, t: int) -> Pipeline:
        """Start a stream at `t` ns; the bins of activity continue unless time went back or their options changed."""
        activity = self._options.activity
        if self._last_t is None or t < self._last_t or activity != self._activity_options:
            self._activity_origin, self._activity_options, activity_start = t, activity, t
        else:
            step = nanoseconds(activity.bin)
            activity_start = max(t - (t - self._activity_origin) % step, self._activity_end)
        start = StreamStart(self._size, t, activity_start, *self._next_ids)
        self._stream = PIPELINES[self._options.tracker](start, self._options, self.statistics)
        return self._stream

    def _count(self, events: EventArray) -> None:
        """Count events for the pyramid, which goes on from stream to stream unless time went back."""
        if self._pyramid is None or (self._last_t is not None and events["t"][0] < self._last_t):
            self._pyramid = PyramidCounter(*self._size)
        self._pyramid.add(events)

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
                f"two pauses of more than {LONGEST_FILLED_GAP / NS_PER_S:.0f} s in one packet: clock errors?"
            )
        width, height = self._size
        if events["x"].max() >= width or events["y"].max() >= height:
            bad = int(np.argmax((events["x"] >= width) | (events["y"] >= height)))
            x, y = events["x"][bad], events["y"][bad]
            raise FrontendError(f"event at pixel ({x}, {y}) is outside of the {width}x{height} sensor")
        if events["p"].min() < 0 or events["p"].max() > 1:
            bad = int(np.argmax((events["p"] < 0) | (events["p"] > 1)))
            raise FrontendError(f"event polarity {events['p'][bad]} is neither 0 nor 1")

    def _output(self, parts: Parts) -> FrontendOutput:
        activity = self._stream.activity.take() if self._stream else None
        observations = Tracks.concatenate(u.observations for u in parts.updates)
        ended = np.sort(np.concatenate([np.empty(0, np.uint32), *(u.ended for u in parts.updates)]))
        corners = LabelledCorners.concatenate(parts.corners)
        pyramid = () if self._pyramid is None else tuple(self._pyramid.take())
        return FrontendOutput(corners, TrackUpdate(observations, ended), activity, pyramid)
