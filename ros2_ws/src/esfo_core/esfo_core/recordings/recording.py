"""What every recording offers, whatever its file format."""

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


@dataclass
class RecordingStatistics:
    """What reading has met so far.

    events, events_on: events that came out, and those of them with polarity 1. first_t, last_t: ns, None before the
    first event. packets: packets or blocks decoded. packets_lost: missing by their sequence numbers.
    packets_damaged: packets that could not be read, skipped. out_of_order: events earlier than one of an earlier
    packet, sorted in. bytes_lost: bytes at the end of a cut-off file that hold nothing whole.
    host_offset: host time minus sensor time in ns of the first packet with events, None where no host time is known.
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
    decoder: DecoderStatistics = field(default_factory=DecoderStatistics)


class Recording(ABC):
    """An event recording on disk.

    path: its file or folder. format: short name of the file format and encoding. width, height: sensor size in pixels.
    size_inferred: neither the file nor the user told the sensor size; it is what the events need.
    size_bytes: size of the file or files. statistics: filled by the latest call of `chunks`.
    unusable_camera: what is wrong with the calibration stored with the events, None where all is well.
    """

    def __init__(self, path: Path, size_bytes: int) -> None:
        self.path = path
        self.size_bytes = size_bytes
        self.format = ""
        self.width = 0
        self.height = 0
        self.size_inferred = False
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
        Steps back of up to `MAX_STEP_BACK` are sorted and counted. Raises RecordingError for a larger step back (after
        the chunks before it), for damage that ends the reading, and for a recording without any event.
        """
        self.statistics = RecordingStatistics()
        order = TimeOrder(duration_ns)
        try:
            for packet in self._packets():
                for chunk in order.push(packet):
                    yield self._counted(chunk)
                self.statistics.out_of_order = order.out_of_order
            for chunk in order.flush():
                yield self._counted(chunk)
        except RecordingError as error:
            raise RecordingError(f"{self.path}: {error}") from error
        except OSError as error:
            raise RecordingError(f"{self.path}: {error.strerror}") from error
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

    def _counted(self, chunk: EventArray) -> EventArray:
        statistics = self.statistics
        statistics.events += len(chunk)
        statistics.events_on += int(np.count_nonzero(chunk["p"]))
        if statistics.first_t is None:
            statistics.first_t = int(chunk["t"][0])
        statistics.last_t = int(chunk["t"][-1])
        return chunk
