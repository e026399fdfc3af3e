"""ROS node that plays a recording: event packets, camera_info and /clock."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import rclpy
from esfo_msgs.msg import EventActivity
from event_camera_msgs.msg import EventPacket
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from tqdm import tqdm

from esfo_bringup.offline.source import choose_camera
from esfo_bringup.replay.messages import acknowledged_until, camera_info_message, clock_message, packet_message
from esfo_bringup.replay.player import Pace, ReplayError, ReplayOptions, packets
from esfo_core.errors import OptionError
from esfo_core.events import NS_PER_S, EventArray
from esfo_core.recordings import open_recording
from esfo_ros.entry_point import run
from esfo_ros.parameters import declare_fields
from esfo_ros.topics import CAMERA_INFO, Topic, reliable

EVENTS = Topic("events", EventPacket, reliable(1000), "encoding `mono`; packets of 2 ms; host time equals sensor time")
CLOCK = Topic("/clock", Clock, reliable(10), "sensor time, every 10 ms")
ACTIVITY = Topic(
    "event_activity",
    EventActivity,
    reliable(1000),
    "with rate 0: acknowledges the events that the front-end has processed",
)

CLOCK_NS = 10_000_000
MATCHING_S = 0.3
"""A subscriber that is known here may need this long to discover the publisher."""


class ReplayNode(Node):  # type: ignore[misc]
    """Publishes a recording; the stamps and /clock are sensor times of the recording."""

    INPUTS = (ACTIVITY,)
    OUTPUTS = (EVENTS, CAMERA_INFO, CLOCK)

    def __init__(self) -> None:
        super().__init__("replay")
        self._options = declare_fields(self, ReplayOptions())
        if not self._options.recording:
            raise OptionError("parameter recording is not set")
        self._recording = open_recording(
            Path(self._options.recording), self._options.topic or None, self._options.reading
        )
        camera = choose_camera(self._recording, self._options.camera)
        self._pace = self._new_pace(self._options.rate)
        self._seq = self._sent_events = 0
        self._ticked: int | None = None
        self._events, self._camera_info, self._time = (
            self.create_publisher(topic.kind, topic.name, topic.qos) for topic in self.OUTPUTS
        )
        if self._options.rate == 0:
            self.create_subscription(ACTIVITY.kind, ACTIVITY.name, self._on_activity, ACTIVITY.qos)
        if camera is None:
            self.get_logger().warning("the recording has no calibration: no camera_info")
        else:
            self._camera_info.publish(camera_info_message(camera, self._options.frame_id))

    def play(self) -> None:
        """Play to the end. Raises ReplayError without subscribers, RecordingError for a damaged recording."""
        executor = SingleThreadedExecutor()
        executor.add_node(self)
        self._wait_for_subscribers(executor)
        with tqdm(total=100, unit="%", desc="replay", disable=None, bar_format="{l_bar}{bar}| {elapsed}") as bar:
            for events in packets(self._recording, self._options.loop):
                self._wait_for_turn(executor, int(events["t"][0]))
                if not rclpy.ok():
                    break
                self._send(events)
                bar.update(100 * self._recording.progress() - bar.n)
        if rclpy.ok():
            self._events.wait_for_all_acked(Duration(seconds=10))
        self.get_logger().info(f"published {self._seq} packets, {self._sent_events} events")

    def _wait_for_subscribers(self, executor: SingleThreadedExecutor) -> None:
        options, begin = self._options, time.monotonic()
        while rclpy.ok():
            there = self._events.get_subscription_count()
            if there >= options.wait_for_subscribers:
                time.sleep(MATCHING_S)
                return
            if time.monotonic() - begin > options.wait_timeout_s:
                wanted = f"{options.wait_for_subscribers} subscribers of {self._events.topic_name}"
                raise ReplayError(f"{there} of {wanted} after {options.wait_timeout_s:g} s")
            executor.spin_once(timeout_sec=0.05)

    def _wait_for_turn(self, executor: SingleThreadedExecutor, t: int) -> None:
        if self._options.rate == 0:
            executor.spin_once(timeout_sec=0.0)
        while rclpy.ok() and (delay := self._pace.delay(t, time.monotonic())) > 0:
            if self._options.rate > 0:
                self._tick(min(t, self._pace.sensor_time(time.monotonic())))
            elif self.count_publishers("event_activity") == 0:
                self.get_logger().warning("no node acknowledges events on event_activity: continuing in real time")
                self._pace = self._new_pace(1.0)
            executor.spin_once(timeout_sec=min(delay, CLOCK_NS / NS_PER_S))

    def _send(self, events: EventArray) -> None:
        last = int(events["t"][-1])
        self._tick(last)
        size = (self._recording.width, self._recording.height)
        self._events.publish(packet_message(events, self._seq, size, self._options.frame_id))
        self._pace.sent(last)
        self._seq += 1
        self._sent_events += len(events)

    def _tick(self, t: int) -> None:
        if self._ticked is None or t >= self._ticked + CLOCK_NS:
            self._ticked = t
            self._time.publish(clock_message(t))

    def _on_activity(self, message: EventActivity) -> None:
        self._pace.acknowledged(acknowledged_until(message), time.monotonic())

    def _new_pace(self, rate: float) -> Pace:
        return Pace(rate, round(self._options.in_flight_s * NS_PER_S), self._options.stall_s)


def main() -> None:
    """Run the node."""
    sys.exit(run(ReplayNode, ReplayNode.play))


if __name__ == "__main__":
    main()
