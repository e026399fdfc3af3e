"""A camera of the tests: sends events as a driver does, and as drivers do that misbehave."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from typing import Any

import spinning_squares
from event_camera_msgs.msg import EventPacket
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo

from esfo_bringup.replay.messages import camera_info_message, packet_message
from esfo_core.events import EventArray
from esfo_ros.topics import latched

SIZE = (spinning_squares.CAMERA.width, spinning_squares.CAMERA.height)


class CameraDriver:
    """Publishes the events that it is given, one packet each, numbered from 0."""

    def __init__(self, node: Any, topic: str = "events", reliability: str = "reliable") -> None:
        self._events = node.create_publisher(
            EventPacket, topic, QoSProfile(depth=1000, reliability=ReliabilityPolicy[reliability.upper()])
        )
        self._camera_info = node.create_publisher(CameraInfo, topic.replace("events", "camera_info"), latched())
        self._camera_info.publish(camera_info())
        self.seq = 0

    @property
    def listeners(self) -> int:
        """Nodes that take the events."""
        return int(self._events.get_subscription_count())

    def send(self, packets: Iterable[EventArray], skip: int = 0) -> None:
        """Publish packets; `skip` numbers are left out before the first, as when packets are lost."""
        self.seq += skip
        for events in packets:
            self._events.publish(packet_message(events, self.seq, SIZE, "camera"))
            self.seq += 1

    def send_garbage(self) -> None:
        """Publish a packet of an encoding that nobody knows."""
        message = EventPacket(width=SIZE[0], height=SIZE[1], encoding="morse", seq=self.seq, events=array("B", [1, 2]))
        self._events.publish(message)
        self.seq += 1


def camera_info() -> Any:
    """Return the calibration of the small scene."""
    return camera_info_message(spinning_squares.CAMERA, "camera")
