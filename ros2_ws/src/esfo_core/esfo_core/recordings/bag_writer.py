"""Writing a ROS 2 bag of one self-contained MCAP file, as rosbag2 writes it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from mcap.writer import CompressionType, Writer

from esfo_core.errors import RecordingError

LIBRARY = "esfo_core"

_FOREVER = "{sec: 9223372036, nsec: 854775807}"


@dataclass(frozen=True)
class BagTopic:
    """A topic of a bag.

    name: with its slash. kind: message type, as `sensor_msgs/msg/Image`. definition: its fields as in its .msg file,
    those of all types within it after them. type_hash: of the definition, by REP 2011. depth: of the queue of the
    publisher, which is reliable. latched: its last messages also reach those that subscribe later.
    """

    name: str
    kind: str
    definition: str
    type_hash: str
    depth: int
    latched: bool

    @property
    def qos(self) -> str:
        """The quality of service that the publisher offers, in the YAML of rosbag2."""
        return (
            f"- {{history: keep_last, depth: {self.depth}, reliability: reliable, "
            f"durability: {'transient_local' if self.latched else 'volatile'}, deadline: {_FOREVER}, "
            f"lifespan: {_FOREVER}, liveliness: automatic, liveliness_lease_duration: {_FOREVER}, "
            "avoid_ros_namespace_conventions: false}\n"
        )


class BagWriter:
    """Writes messages, in any order of time: the bag's index puts them in order.

    Until `finish` the file is called `<path>.part`; `discard` removes it. As a context manager it finishes, or discards
    after an error. The same messages give the same bytes.

    Every method raises RecordingError when the file cannot be written.
    """

    def __init__(self, path: Path, compress: bool = False) -> None:
        """Create the file. compress: with LZ4, in pieces of 1 MiB that are read one by one."""
        self._path, self._part = path, path.with_name(path.name + ".part")
        with self._one_kind_of_error():
            self._file = self._part.open("wb")
            self._writer = Writer(self._file, compression=CompressionType.LZ4 if compress else CompressionType.NONE)
            self._writer.start(profile="ros2", library=LIBRARY)

    def add_topic(self, topic: BagTopic) -> int:
        """Add a topic; return the number by which `write` knows it."""
        schema = self._writer.register_schema(topic.kind, "ros2msg", topic.definition.encode())
        metadata = {"offered_qos_profiles": topic.qos, "topic_type_hash": topic.type_hash}
        return self._writer.register_channel(topic.name, "cdr", schema, metadata)

    def write(self, topic: int, t: int, cdr: bytes, sequence: int = 0) -> None:
        """Add a message, serialised as CDR, that was published at `t` ns."""
        with self._one_kind_of_error():
            self._writer.add_message(topic, t, cdr, t, sequence)

    def finish(self) -> None:
        """Complete the bag and give it its name."""
        try:
            with self._one_kind_of_error():
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._file.close()
                self._part.replace(self._path)
        finally:
            self.discard()

    def discard(self) -> None:
        """Delete the file unless it is complete."""
        with suppress(OSError):  # an error on closing does not matter: the file is deleted
            self._file.close()
        self._part.unlink(missing_ok=True)

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.finish()
        else:
            self.discard()

    @contextmanager
    def _one_kind_of_error(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise RecordingError(f"{self._path}: {error.strerror}") from error
