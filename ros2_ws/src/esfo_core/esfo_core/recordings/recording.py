"""Base class of the recordings of all file formats."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from esfo_core.camera import Camera
from esfo_core.codecs import DecoderStatistics
from esfo_core.errors import EsfoError, RecordingError
from esfo_core.events import EventArray
from esfo_core.recordings.ordering import TimeOrder

CHUNK_NS = 10_000_000
MAX_SEGMENTS = 1000
"""A clock is set back a few times at most; in random bytes, time steps back at every event."""


@dataclass
class RecordingStatistics:
    """Counters of reading.

    events, events_on: events that came out, and those of them with polarity 1. first_t, last_t: ns, None before the
    first event. packets: packets or blocks decoded. packets_lost: missing by their sequence numbers.
    packets_damaged: packets that could not be read, skipped. out_of_order: events earlier than one of an earlier
    packet, sorted in. bytes_lost: bytes at the end of a cut-off file that hold nothing whole.
    host_offset: host time minus sensor time in ns of the first packet with events, None where no host time is known.
    segments: stretches of time, one more than the clock was set back. events_elsewhere: events of the segments that
    were not asked for. decoder: counters of the decoder.
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
    segments: int = 1
    events_elsewhere: int = 0
    decoder: DecoderStatistics = field(default_factory=DecoderStatistics)


class Recording(ABC):
    """An event recording on disk.

    path: its file or folder. format: short name of the file format and encoding. width, height: sensor size in pixels.
    size_inferred: neither the file nor the user told the sensor size; it is what the events need.
    size_bytes: size of the file or files. statistics: filled by the latest call of `chunks`.
    segment: number of the stretch that `chunks` yields, of a recording whose clock is set back; 0 is the first.
    unusable_camera: what is wrong with the calibration stored with the events, None where all is well.
    """

    def __init__(self, path: Path, size_bytes: int) -> None:
        self.path = path
        self.size_bytes = size_bytes
        self.format = ""
        self.width = 0
        self.height = 0
        self.size_inferred = False
        self.segment = 0
        self.unusable_camera: EsfoError | None = None
        self.statistics = RecordingStatistics()
        self._camera: Camera | None = None

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
        Steps back of up to `MAX_STEP_BACK` are sorted and counted; at a larger one a new segment begins, and only the
        one of number `segment` is yielded. Raises RecordingError for damage that ends the reading (after the chunks
        before it), for more than `MAX_SEGMENTS`, and for a segment without any event.
        """
        self.statistics = RecordingStatistics()
        order = TimeOrder(duration_ns)
        try:
            for packet in self._packets():
                if order.starts_anew(packet):
                    yield from self._chosen(order.flush())
                    self._begin_segment()
                    order = TimeOrder(duration_ns)
                before = order.out_of_order
                yield from self._chosen(order.push(packet))
                self.statistics.out_of_order += order.out_of_order - before
            yield from self._chosen(order.flush())
        except RecordingError as error:
            raise RecordingError(f"{self.path}: {error}") from error
        except OSError as error:
            raise RecordingError(f"{self.path}: {error.strerror}") from error
        if self.segment >= self.statistics.segments:
            back = self.statistics.segments - 1
            raise RecordingError(f"{self.path}: no segment {self.segment}: the clock is set back {back} times")
        if not self.statistics.events:
            raise RecordingError(f"{self.path}: no events in {self.statistics.packets} packets of {self.format}")

    @abstractmethod
    def progress(self) -> float:
        """Fraction of the recording that `chunks` has read, 0 to 1."""

    @abstractmethod
    def _packets(self) -> Iterator[EventArray]:
        """Decode the recording from its start; fill `statistics` but for the events and their order.

        Raises RecordingError without the path, and OSError; `chunks` adds the path.
        """

    def _begin_segment(self) -> None:
        self.statistics.segments += 1
        if self.statistics.segments > MAX_SEGMENTS:
            raise RecordingError(
                f"the clock is set back more than {MAX_SEGMENTS - 1} times: these are no times of events"
            )

    def _chosen(self, chunks: Iterator[EventArray]) -> Iterator[EventArray]:
        """Pass on the chunks of the segment that was asked for; count the events of the others."""
        for chunk in chunks:
            if self.statistics.segments - 1 == self.segment:
                yield self._counted(chunk)
            else:
                self.statistics.events_elsewhere += len(chunk)

    def _counted(self, chunk: EventArray) -> EventArray:
        statistics = self.statistics
        statistics.events += len(chunk)
        statistics.events_on += int(np.count_nonzero(chunk["p"]))
        if statistics.first_t is None:
            statistics.first_t = int(chunk["t"][0])
        statistics.last_t = int(chunk["t"][-1])
        return chunk
