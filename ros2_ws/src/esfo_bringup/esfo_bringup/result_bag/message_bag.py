"""A bag that takes ROS messages."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from esfo_bringup.result_bag.cdr import serialise
from esfo_bringup.result_bag.messages import bag_topic
from esfo_core.recordings.bag_writer import BagWriter
from esfo_ros.topics import Topic


class MessageBag:
    """Writes messages on the topics of the nodes, in the root namespace. Raises RecordingError as `BagWriter`."""

    def __init__(self, path: Path) -> None:
        self._writer = BagWriter(path, compress=True)
        self._numbers: dict[str, int] = {}

    def add_topics(self, topics: Iterable[Topic]) -> None:
        """Add topics; one without messages stays empty."""
        for topic in topics:
            self._numbers[topic.name] = self._writer.add_topic(bag_topic(topic))

    def publish(self, topic: str, t: int, message: Any) -> None:
        """Write a message that is published at `t` ns."""
        self._writer.write(self._numbers[topic], t, serialise(message))

    def finish(self) -> None:
        """Complete the bag and give it its name."""
        self._writer.finish()

    def discard(self) -> None:
        """Delete the bag unless it is complete."""
        self._writer.discard()
