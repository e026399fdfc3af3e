"""Messages of one ROS bag file, with every failure of the bag libraries turned into RecordingError."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rosbags.interfaces import MessageDefinitionFormat
from rosbags.rosbag1 import Reader as Rosbag1Reader
from rosbags.rosbag2 import Reader as Rosbag2Reader

from esfo_core.errors import EsfoError, RecordingError
from esfo_core.recordings.broken_sqlite import is_cut, log_of, merged, rescued
from esfo_core.recordings.event_messages import check_definition, reader_of
from esfo_core.recordings.scanned_mcap import ScannedMcap


class BagFile:
    """One MCAP, SQLite or ROS 1 bag file, chosen by its extension and opened anew for each question.

    An MCAP with a damaged chunk is read on as `ScannedMcap`. bytes_lost: bytes missing at the end of an SQLite file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.bytes_lost = 0
        log = log_of(path) if path.suffix == ".db3" else None
        if log is not None:
            self._folder = TemporaryDirectory(prefix="esfo_")  # goes with this object
            self.path = merged(path, log, self._folder)
        elif path.suffix == ".db3" and is_cut(path):
            self._folder = TemporaryDirectory(prefix="esfo_")
            self.path, self.bytes_lost = rescued(path, self._folder)
        self._ros1 = path.suffix == ".bag"

    def topics(self, kinds: Sequence[str]) -> dict[tuple[str, str], int]:
        """Numbers of messages by topic and type, of the topics of the message types `kinds`.

        Raises RecordingError where the bag defines an event array differently.
        """
        counts: dict[tuple[str, str], int] = {}
        try:
            self._take_counts(kinds, counts)
        except RecordingError:
            rescued = ScannedMcap(self.path).topics(kinds) if self.path.suffix == ".mcap" else {}
            if not rescued:
                raise
            return rescued
        return counts

    def _take_counts(self, kinds: Sequence[str], counts: dict[tuple[str, str], int]) -> None:
        with self._open() as reader:
            for c in reader.connections:
                if c.msgtype in kinds:
                    check_definition(c.msgtype, c.msgdef.data if c.msgdef.format == MessageDefinitionFormat.MSG else "")
                    counts[c.topic, c.msgtype] = counts.get((c.topic, c.msgtype), 0) + c.msgcount

    def messages(self, topic: str, kind: str) -> Iterator[Any]:
        """Messages of one topic in the order of their log times; None for one that cannot be deserialised."""
        count = 0
        try:
            for message in self._indexed(topic, kind):
                yield message
                count += 1
        except RecordingError:
            if self.path.suffix != ".mcap":
                raise
            yield from islice(ScannedMcap(self.path).messages(topic, kind), count, None)

    def _indexed(self, topic: str, kind: str) -> Iterator[Any]:
        read = reader_of(kind, self._ros1)
        with self._open() as reader:
            connections = [c for c in reader.connections if c.topic == topic and c.msgtype == kind]
            entries = reader.messages(connections=connections) if connections else iter(())
            while True:
                with _one_error(self.path.name):
                    entry = next(entries, None)
                if entry is None:
                    return
                try:
                    message = read(entry[2])
                except Exception:  # noqa: BLE001 - damaged bytes raise anything; the caller counts the loss
                    message = None
                yield message

    @contextmanager
    def _open(self) -> Iterator[Any]:
        with ExitStack() as stack:
            with _one_error(self.path.name):
                reader = Rosbag1Reader(self.path) if self._ros1 else Rosbag2Reader(self.path)
                stack.enter_context(reader)
            yield reader


@contextmanager
def _one_error(name: str) -> Iterator[None]:
    try:
        yield
    except EsfoError:
        raise
    except Exception as error:  # damaged bytes raise anything from struct.error to AssertionError
        reason = (str(error).splitlines() or [""])[0] or type(error).__name__
        raise RecordingError(f"damaged or unreadable bag file {name} ({reason})") from error
