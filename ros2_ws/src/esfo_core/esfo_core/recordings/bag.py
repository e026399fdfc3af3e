"""Recordings in ROS bags: packets or arrays of events and, where there is one, their `CameraInfo`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from esfo_core.camera import Camera
from esfo_core.codecs import Decoder, decoder
from esfo_core.errors import EsfoError, RecordingError
from esfo_core.events import EventArray
from esfo_core.packets import EVENT_ARRAYS, SUPPORTED, Packet
from esfo_core.recordings.bag_file import BagFile
from esfo_core.recordings.camera_topics import camera_of
from esfo_core.recordings.messages import CAMERA_INFO
from esfo_core.recordings.reading_options import ReadingOptions
from esfo_core.recordings.recording import Recording
from esfo_core.recordings.scanned_mcap import ScannedMcap, is_cut, is_of_ros1


class BagRecording(Recording):
    """Events of one topic of a bag that consists of one or several files.

    The camera is that of the `camera_info` topic beside the event topic, or else of the only other `CameraInfo` topic
    that describes a sensor of the same size; uncalibrated messages are skipped. Where neither the options nor the
    messages tell the sensor size, all events are read once for it.

    Raises RecordingError for a bag without events, or with several event topics unless `topic` names one.
    """

    def __init__(
        self, path: Path, files: Sequence[Path], kind: str, topic: str | None, options: ReadingOptions
    ) -> None:
        super().__init__(path, sum(file.stat().st_size for file in files))
        self._files = [_opened(file) for file in files]
        topics = self._topics(SUPPORTED)
        self.topic, self._kind = _choose(topics, topic)
        self._messages = topics[self.topic, self._kind]
        first: Packet | None = next((m for m in self._all(self.topic, self._kind) if m is not None), None)
        if first is None:
            raise RecordingError(f"no readable message on the event topic {self.topic!r}")
        self._form = (first.width, first.height, first.encoding)
        self.encoding = first.encoding
        self.format = f"{kind}, {self._kind.replace('/msg/', '/') if self._kind in EVENT_ARRAYS else self.encoding}"
        told = (first.width, first.height) if first.width and first.height else None
        size = told or options.size
        self.width, self.height = size or (1, 1)
        self._new_decoder()
        self.width, self.height = size or self._size_of_events()
        self.size_inferred = size is None
        try:
            self.camera = self._find_camera()
        except EsfoError as error:
            self.unusable_camera = type(error)(f"{path}: {error}")

    def progress(self) -> float:
        """Fraction of the event messages read."""
        statistics = self.statistics
        return min(1.0, (statistics.packets + statistics.packets_damaged) / max(1, self._messages))

    def _packets(self) -> Iterator[EventArray]:
        events_of = self._new_decoder()
        statistics = self.statistics
        statistics.decoder = events_of.statistics
        statistics.bytes_lost = sum(file.bytes_lost for file in self._files)
        latest: int | None = None
        packets: Iterator[Packet | None] = self._all(self.topic, self._kind)
        for packet in packets:
            if packet is None:
                statistics.packets_damaged += 1
                events_of.resynchronise()
                latest = None if latest is None else latest + 1  # it had a number too: damaged, not lost
                continue
            self._check_same(packet)
            seq = statistics.packets if packet.seq is None else packet.seq
            if latest is not None and seq > latest + 1 and packet.seq is not None:
                statistics.packets_lost += seq - latest - 1
                events_of.resynchronise()
            latest = seq
            statistics.packets += 1
            try:
                parts = events_of.decode_parts(packet.data, packet.time_base)
            except RecordingError as error:
                raise RecordingError(f"packet {seq}: {error}") from error
            if statistics.host_offset is None and len(parts[0]):
                statistics.host_offset = packet.stamp - int(parts[0]["t"][0])
            yield from parts

    def _all(self, topic: str, kind: str) -> Iterator[Any]:
        for file in self._files:
            yield from file.messages(topic, kind)

    def _topics(self, kinds: Sequence[str]) -> dict[tuple[str, str], int]:
        counts: dict[tuple[str, str], int] = {}
        for file in self._files:
            for key, count in file.topics(kinds).items():
                counts[key] = counts.get(key, 0) + count
        return counts

    def _new_decoder(self) -> Decoder:
        try:
            return decoder(self.encoding, self.width, self.height)
        except RecordingError as error:
            raise RecordingError(f"topic {self.topic!r}: {error}") from error

    def _check_same(self, packet: Packet) -> None:
        found = (packet.width, packet.height, packet.encoding)
        if found != self._form:
            width, height, encoding = self._form
            raise RecordingError(
                f"packet {packet.seq} of {self.topic!r} is {found[0]}x{found[1]} {found[2]!r} after "
                f"{width}x{height} {encoding!r}"
            )
        if packet.big_endian:
            raise RecordingError(f"packet {packet.seq} of {self.topic!r} is big-endian")

    def _find_camera(self) -> Camera | None:
        beside = self.topic.rpartition("/")[0] + "/camera_info"
        topics = sorted((topic for topic, _ in self._topics([CAMERA_INFO])), key=lambda topic: topic != beside)
        infos = {topic: (m for m in self._all(topic, CAMERA_INFO) if m is not None) for topic in topics}
        return camera_of(infos, beside, (self.width, self.height))


def _opened(file: Path) -> BagFile | ScannedMcap:
    if file.suffix == ".mcap" and (is_cut(file) or is_of_ros1(file)):
        return ScannedMcap(file)
    return BagFile(file)


def _choose(topics: dict[tuple[str, str], int], wanted: str | None) -> tuple[str, str]:
    """Return name and type of the topic to read, from the numbers of messages of all event topics."""
    if not topics:
        raise RecordingError(f"the bag has no topic of type {', '.join(SUPPORTED)}")
    names = ", ".join(sorted(topic for topic, _ in topics))
    candidates = [key for key in topics if wanted in (None, key[0])]
    if not candidates:
        raise RecordingError(f"no event topic {wanted!r}; event topics: {names}")
    filled = [key for key in candidates if topics[key]]
    if len(filled) > 1:
        raise RecordingError(f"several event topics, choose one of {names}")
    if not filled:
        raise RecordingError(f"no messages on the event topic {wanted or names}")
    return filled[0]
