"""MCAP files without their end: what a recorder leaves that was killed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader

from esfo_core.recordings.event_messages import check_definition, reader_of

MAGIC = b"\x89MCAP0\r\n"


def is_cut(path: Path) -> bool:
    """Return whether an MCAP file lacks the magic bytes at its end."""
    with path.open("rb") as file:
        file.seek(-min(len(MAGIC), path.stat().st_size), 2)
        return file.read() != MAGIC or path.stat().st_size < 2 * len(MAGIC)


class CutMcap:
    """The whole records of a cut-off MCAP file, in the order of the file.

    bytes_lost: bytes after the last whole record.

    Raises RecordingError where the file defines an event array differently.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._counts: dict[tuple[str, str], int] = {}
        self.bytes_lost = path.stat().st_size
        for topic, kind, _, position in self._records():
            self._counts[topic, kind] = self._counts.get((topic, kind), 0) + 1
            self.bytes_lost = path.stat().st_size - position

    def topics(self, kinds: Sequence[str]) -> dict[tuple[str, str], int]:
        """Numbers of messages by topic and type, of the topics of the message types `kinds`."""
        return {key: count for key, count in self._counts.items() if key[1] in kinds}

    def messages(self, topic: str, kind: str) -> Iterator[Any]:
        """Messages of one topic; None for one that cannot be deserialised."""
        read = reader_of(kind)
        for found_topic, found_kind, data, _ in self._records():
            if (found_topic, found_kind) == (topic, kind):
                try:
                    message = read(data)
                except Exception:  # noqa: BLE001 - damaged bytes raise anything; the caller counts the loss
                    message = None
                yield message

    def _records(self) -> Iterator[tuple[str, str, bytes, int]]:
        """Topic, type, data and file position after each message, up to the cut."""
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        with self._path.open("rb") as file:
            records = iter(StreamReader(file, record_size_limit=self._path.stat().st_size).records)
            while True:
                try:
                    record = next(records, None)
                except Exception:  # noqa: BLE001 - a cut can fall anywhere, and then the library raises anything
                    return
                if record is None:
                    return
                if isinstance(record, Schema):
                    check_definition(record.name, record.data.decode() if record.encoding == "ros2msg" else "")
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message) and record.channel_id in channels:
                    channel = channels[record.channel_id]
                    if channel.schema_id in schemas:
                        yield channel.topic, schemas[channel.schema_id].name, record.data, file.tell()
