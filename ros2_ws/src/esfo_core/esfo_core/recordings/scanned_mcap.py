"""MCAP files that their index does not open: without their end, with damaged chunks, or with messages of ROS 1."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO

from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Header, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from esfo_core.recordings.event_messages import check_definition, reader_of

MAGIC = b"\x89MCAP0\r\n"
_ROS1 = "ros1"


def is_cut(path: Path) -> bool:
    """Return whether an MCAP file lacks the magic bytes at its end."""
    with path.open("rb") as file:
        file.seek(-min(len(MAGIC), path.stat().st_size), 2)
        return file.read() != MAGIC or path.stat().st_size < 2 * len(MAGIC)


def is_of_ros1(path: Path) -> bool:
    """Return whether an MCAP file says that it holds messages of ROS 1."""
    with path.open("rb") as file:
        try:
            header = next(iter(StreamReader(file, record_size_limit=path.stat().st_size).records))
        except Exception:  # noqa: BLE001 - whatever is wrong is told by who reads it
            return False
    return isinstance(header, Header) and header.profile == _ROS1


class ScannedMcap:
    """The whole records of an MCAP file, in the order of the file; chunks that are damaged are left out.

    bytes_lost: bytes after the last whole record of a file that was cut off.

    Raises RecordingError where the file defines an event array differently.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._counts: dict[tuple[str, str], int] = {}
        end = 0
        for record in self._records():
            if record is not None:
                topic, kind, _, _, end = record
                self._counts[topic, kind] = self._counts.get((topic, kind), 0) + 1
        self.bytes_lost = path.stat().st_size - end if is_cut(path) else 0

    def topics(self, kinds: Sequence[str]) -> dict[tuple[str, str], int]:
        """Numbers of messages by topic and type, of the topics of the message types `kinds`."""
        return {key: count for key, count in self._counts.items() if key[1] in kinds}

    def messages(self, topic: str, kind: str) -> Iterator[Any]:
        """Messages of one topic; None for one that cannot be deserialised, and for a damaged chunk."""
        readers = {ros1: reader_of(kind, ros1) for ros1 in (False, True)}
        for record in self._records():
            if record is None:
                yield None
            elif record[:2] == (topic, kind):
                try:
                    message = readers[record[3]](record[2])
                except Exception:  # noqa: BLE001 - damaged bytes raise anything; the caller counts the loss
                    message = None
                yield message

    def _records(self) -> Iterator[tuple[str, str, bytes, bool, int] | None]:
        """Topic, type, data, whether they are of ROS 1, and file position after each message; None: a damaged chunk."""
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        with self._path.open("rb") as file:
            for record, position in self._plain_records(file):
                if isinstance(record, Schema):
                    check_definition(_ros2_name(record.name), record.data.decode("utf-8", "replace"))
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif record is None:
                    yield None
                elif isinstance(record, Message) and record.channel_id in channels:
                    channel = channels[record.channel_id]
                    if channel.schema_id in schemas:
                        kind = _ros2_name(schemas[channel.schema_id].name)
                        yield channel.topic, kind, record.data, channel.message_encoding == _ROS1, position

    def _plain_records(self, file: BinaryIO) -> Iterator[tuple[Any, int]]:
        """Records in and outside of chunks, with the file position after them; None for a damaged chunk."""
        for record, position in self._outer_records(file):
            if not isinstance(record, Chunk):
                yield record, position
                continue
            try:
                inner = breakup_chunk(record, validate_crc=True)
            except Exception:  # noqa: BLE001 - damaged bytes raise anything
                yield None, position
                continue
            for each in inner:
                yield each, position

    def _outer_records(self, file: BinaryIO) -> Iterator[tuple[Any, int]]:
        """Records of the file; where one cannot be read, on from the next chunk of the index, if there is one."""
        limit = self._path.stat().st_size
        records = iter(StreamReader(file, emit_chunks=True, record_size_limit=limit).records)
        position = 0
        while True:
            try:
                record = next(records, None)
            except Exception:  # noqa: BLE001 - a cut can fall anywhere, and then the library raises anything
                start = self._next_chunk(position)
                if start is None:
                    return
                yield None, start
                position = start
                file.seek(start)
                records = iter(StreamReader(file, True, emit_chunks=True, record_size_limit=limit).records)
                continue
            if record is None:
                return
            position = file.tell()
            yield record, position

    def _next_chunk(self, position: int) -> int | None:
        """Where the first chunk after `position` begins that the index at the end of the file knows; None: none."""
        try:
            with self._path.open("rb") as file:
                summary = SeekingReader(file).get_summary()
            starts = [] if summary is None else [chunk.chunk_start_offset for chunk in summary.chunk_indexes]
        except Exception:  # noqa: BLE001 - there is no index, or it is damaged too
            return None
        return min((start for start in starts if start > position), default=None)


def _ros2_name(kind: str) -> str:
    """Name of a type as ROS 2 has it: ROS 1 leaves out the folder."""
    package, _, name = kind.partition("/")
    return kind if "/" in name else f"{package}/msg/{name}"
