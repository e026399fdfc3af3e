"""Writes the stream of an offline run as the messages that a live run publishes."""

from __future__ import annotations

from pathlib import Path

from esfo_bringup.offline.pipeline import RunResult
from esfo_bringup.offline.source import Source
from esfo_bringup.replay.messages import packet_message
from esfo_bringup.replay.player import ReplayOptions, cut
from esfo_bringup.result_bag.frames import Frames
from esfo_bringup.result_bag.message_bag import MessageBag
from esfo_bringup.result_bag.messages import STREAM_TOPICS
from esfo_bringup.result_bag.outcome import write_outcome
from esfo_bringup.result_bag.stream_health import HealthReport
from esfo_core.events import EventArray
from esfo_frontend.frontend import FrontendOutput
from esfo_frontend.ros.messages import output_messages
from esfo_ros.diagnostics import diagnostic_message
from esfo_ros.time_stamps import from_stamp, to_stamp

FRAME_NS = 66_666_667
"""Period of the overlay."""

CAMERA_FRAME = ReplayOptions().frame_id


class Recorder:
    """Writes all topics of a live run into one bag, in sensor time: the stream during the run, the result at its end.

    Raises RecordingError when the file cannot be written, EsfoError for times that a ROS stamp cannot hold.
    """

    def __init__(self, path: Path, source: Source, events: bool) -> None:
        """events: write them, in the packets of the replay."""
        self._source, self._with_events = source, events
        self._size = (source.recording.width, source.recording.height)
        self._frames = Frames(*self._size, FRAME_NS, path.parent)
        self._bag = MessageBag(path)
        self._bag.add_topics(STREAM_TOPICS)
        self._first: int | None = None
        self._last = self._packets = 0

    def add(self, events: EventArray, output: FrontendOutput, health: HealthReport | None) -> None:
        """Write events (N,), which follow the earlier ones, what they settled, and the health of the stream."""
        if len(events):
            self._first = int(events["t"][0]) if self._first is None else self._first
            self._last = int(events["t"][-1])
            if self._with_events:
                self._write_packets(events, self._first)
            self._frames.add(events)
        for topic, message in output_messages(output, self._last, 0, CAMERA_FRAME):
            self._bag.publish(topic, from_stamp(message.header.stamp), message)
        if health is not None:
            status = diagnostic_message("/frontend", to_stamp(health.t), health.problems, health.counts)
            self._bag.publish("/diagnostics", health.t, status)

    def finish(self, result: RunResult) -> None:
        """Write the result of the run and complete the bag. The recording had events."""
        assert self._first is not None
        write_outcome(self._bag, result, self._source, self._frames, (self._first, self._last))
        self._bag.finish()
        self._frames.close()

    def discard(self) -> None:
        """Delete the bag unless it is complete."""
        self._bag.discard()
        self._frames.close()

    def _write_packets(self, events: EventArray, first: int) -> None:
        for packet in cut(events, first):
            message = packet_message(packet, self._packets, self._size, CAMERA_FRAME)
            self._bag.publish("events", int(packet["t"][-1]), message)
            self._packets += 1
