"""Base class of the recordings of all file formats."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from esfo_core.camera import Camera
from esfo_core.codecs import DecoderStatistics
from esfo_core.codecs.time_check import TimeCheck
from esfo_core.errors import EsfoError, RecordingError
from esfo_core.events import EventArray
from esfo_core.recordings.extent import Extent
from esfo_core.recordings.ordering import TimeOrder

CHUNK_NS = 10_000_000
HELD_EVENTS = 1 << 17
"""Events that are held back until it is known whether the clock is set back soon, 1.7 MB: more would slow reading."""

MAX_SEGMENTS = 1000
"""A clock is set back a few times at most; in random bytes, time steps back at every event."""

_MOST_LISTED = 20

MOST_EVENTS = -1
"""As the number of a segment: the one with the most events."""


@dataclass
class Segment:
    """A stretch of time between two settings of the clock: its events, and the first and last of their times in ns."""

    events: int = 0
    first_t: int = 0
    last_t: int = 0


@dataclass
class RecordingStatistics:
    """Counters of reading.

    events, events_on: events that came out, and those of them with polarity 1. first_t, last_t: ns, None before the
    first event. packets: packets or blocks decoded. packets_lost: missing by their sequence numbers.
    packets_damaged: packets that could not be read, skipped. out_of_order: events earlier than one of an earlier
    packet, sorted in. bytes_lost: bytes at the end of a cut-off file that hold nothing whole.
    host_offset: host time minus sensor time in ns of the first packet with events, None where no host time is known.
    outliers: events dropped whose times those around them contradict. stretches: the segments met so far, one more than
    the clock was set back. first_fault: what is wrong with the first line of text that was skipped.
    decoder: counters of the decoder.
    """

    events: int = 0
    events_on: int = 0
    first_t: int | None = None
    last_t: int | None = None
    packets: int = 0
    packets_lost: int = 0
    packets_damaged: int = 0
    out_of_order: int = 0
    bytes_lost: int = 0
    host_offset: int | None = None
    outliers: int = 0
    first_fault: str = ""
    stretches: list[Segment] = field(default_factory=lambda: [Segment()])
    decoder: DecoderStatistics = field(default_factory=DecoderStatistics)

    @property
    def segments(self) -> int:
        """Number of segments met so far."""
        return len(self.stretches)

    @property
    def events_elsewhere(self) -> int:
        """Events of the segments that were not read."""
        return sum(stretch.events for stretch in self.stretches) - self.events


class Recording(ABC):
    """An event recording on disk.

    path: its file or folder. format: short name of the file format and encoding. width, height: sensor size in pixels.
    size_inferred: neither the file nor the user told the sensor size; it is what the events need.
    guesses: what else the reader found out from the events, each with the option that says otherwise.
    size_bytes: size of the file or files. statistics: filled by the latest call of `chunks`.
    wanted_segment: number of the segment that `chunks` is to yield, of a recording whose clock is set back; 0 is the
    first. segment: the one that it yields, once that is known.
    unpacked_from: the compressed file or the pipe that the recording was unpacked from, None where it was none.
    unpacked_to: the temporary folders that it lies in; they go with this object.
    unusable_camera: what is wrong with the calibration stored with the events, None where all is well.
    """

    def __init__(self, path: Path, size_bytes: int) -> None:
        self.path = path
        self.size_bytes = size_bytes
        self.format = ""
        self.width = 0
        self.height = 0
        self.size_inferred = False
        self.guesses: tuple[str, ...] = ()
        self.wanted_segment = MOST_EVENTS
        self.segment = 0
        self.unusable_camera: EsfoError | None = None
        self.unpacked_from: Path | None = None
        self.unpacked_to: list[TemporaryDirectory[str]] = []
        self.statistics = RecordingStatistics()
        self._camera: Camera | None = None

    @property
    def named_path(self) -> Path:
        """The path as the user knows it: of the compressed file, where there is one."""
        return self.unpacked_from or self.path

    @property
    def camera(self) -> Camera | None:
        """Calibration stored with the events, None where there is none.

        Raises `unusable_camera`: an impossible calibration matters only to who uses it.
        """
        if self.unusable_camera is not None:
            raise self.unusable_camera
        return self._camera

    @camera.setter
    def camera(self, camera: Camera | None) -> None:
        self._camera = camera

    def chunks(self, duration_ns: int = CHUNK_NS) -> Iterator[EventArray]:
        """Read the recording from its start, in chunks of `duration_ns` counted from the first event.

        Yields time-sorted events (N,), N > 0, none earlier than those before; stretches without events are left out.
        Times are sensor times in ns. Memory does not grow with the length of the recording.
        Steps back of up to `MAX_STEP_BACK` are sorted and counted. A stretch further off is dropped and counted where
        the stream then goes on as before; a clock that is set back and stays so begins a new segment (`TimeCheck`).
        Only one segment is yielded: that of number `wanted_segment`, or else the one with the most events, for which
        the recording is read twice more where the clock is set back within its first `HELD_EVENTS`.

        Raises RecordingError for damage that ends the reading (after the chunks before it), for more than
        `MAX_SEGMENTS`, for a segment without any event, and, after the last chunk, where a later segment turns out to
        have more events than the first one.
        """
        try:
            if self.wanted_segment == MOST_EVENTS:
                yield from self._largest(duration_ns)
            else:
                yield from self._one(self.wanted_segment, duration_ns)
        except RecordingError as error:
            raise RecordingError(f"{self.named_path}: {error}") from error
        except OSError as error:
            raise RecordingError(f"{self.named_path}: {error.strerror or error}") from error
        if self.segment >= self.statistics.segments:
            back = self.statistics.segments - 1
            raise RecordingError(f"{self.named_path}: no segment {self.segment}: the clock is set back {back} times")
        if not self.statistics.events:
            raise RecordingError(f"{self.named_path}: no events in {self.statistics.packets} packets of {self.format}")

    @abstractmethod
    def progress(self) -> float:
        """Fraction of the recording that `chunks` has read, 0 to 1."""

    @abstractmethod
    def _packets(self) -> Iterator[EventArray]:
        """Decode the recording from its start; fill `statistics` but for the events and their order.

        Raises RecordingError without the path, and OSError; `chunks` adds the path.
        """

    def _size_of_events(self) -> tuple[int, int]:
        """Sensor size that holds the events but for stray ones; reads them all. Raises RecordingError as `Extent`."""
        self.width = self.height = 1 << 16
        extent = Extent()
        for events in self._packets():
            extent.add(events["x"], events["y"])
        self.statistics = RecordingStatistics()
        return extent.size()

    def _largest(self, duration_ns: int) -> Iterator[EventArray]:
        """Chunks of the segment with the most events. The first one is taken for it once it is long."""
        held: list[EventArray] = []
        first_is_long = False
        try:
            for number, chunk in self._segments(0, duration_ns):
                if number > 0 and not first_is_long:
                    break
                if number == 0:
                    held.append(chunk)
                    first_is_long = self.statistics.events > HELD_EVENTS
                if first_is_long:
                    yield from held
                    held.clear()
            else:
                yield from held
                self._check_first()
                return
        except (RecordingError, OSError):
            yield from held
            raise
        for _ in self._segments(0, duration_ns):
            pass  # only to count
        yield from self._one(self._most_events(), duration_ns)

    def _most_events(self) -> int:
        return int(np.argmax([stretch.events for stretch in self.statistics.stretches]))

    def _check_first(self) -> None:
        most = self._most_events()
        if most:
            listed = ", ".join(
                f"segment {number} of {stretch.events} events in {(stretch.last_t - stretch.first_t) / 1e9:.3f} s"
                for number, stretch in enumerate(self.statistics.stretches[:_MOST_LISTED])
            )
            raise RecordingError(
                f"the clock is set back late, and segment {most} has more events than the first, which was read; say "
                f"which to read by the option segment: {listed}"
            )

    def _one(self, segment: int, duration_ns: int) -> Iterator[EventArray]:
        return (chunk for number, chunk in self._segments(segment, duration_ns) if number == segment)

    def _segments(self, segment: int, duration_ns: int) -> Iterator[tuple[int, EventArray]]:
        """Read from the start: chunks of all segments, with their numbers; the statistics are of one `segment`."""
        self.segment = segment
        self.statistics = RecordingStatistics()
        order = TimeOrder(duration_ns)
        number = 0
        for events, anew in self._checked():
            if anew:
                for chunk in order.flush():
                    yield number, self._counted(number, chunk)
                number += 1
                self._begin_segment()
                order = TimeOrder(duration_ns)
            before = order.out_of_order
            for chunk in order.push(events):
                yield number, self._counted(number, chunk)
            self.statistics.out_of_order += order.out_of_order - before
        for chunk in order.flush():
            yield number, self._counted(number, chunk)

    def _checked(self) -> Iterator[tuple[EventArray, bool]]:
        """Packets whose times hold, and whether a new segment begins with them."""
        check = TimeCheck()
        for packet in self._packets():
            if check.goes_on(packet):
                yield packet, False
                continue
            yield from check.push(packet)
            self.statistics.outliers = check.outliers
        yield from check.flush()
        self.statistics.outliers = check.outliers

    def _begin_segment(self) -> None:
        if self.statistics.segments == MAX_SEGMENTS:
            raise RecordingError(
                f"the clock is set back more than {MAX_SEGMENTS - 1} times: these are no times of events"
            )
        self.statistics.stretches.append(Segment())

    def _counted(self, number: int, chunk: EventArray) -> EventArray:
        """Count the events of the segment `number`."""
        statistics = self.statistics
        first, last = int(chunk["t"][0]), int(chunk["t"][-1])
        stretch = statistics.stretches[number]
        stretch.first_t = stretch.first_t if stretch.events else first
        stretch.last_t = last
        stretch.events += len(chunk)
        if number == self.segment:
            statistics.events += len(chunk)
            statistics.events_on += int(np.count_nonzero(chunk["p"]))
            statistics.first_t = first if statistics.first_t is None else statistics.first_t
            statistics.last_t = last
        return chunk
