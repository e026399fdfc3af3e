"""Topics of the nodes: type, quality of service, and why a publisher and a subscription do not connect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo

_BEST_EFFORT, _VOLATILE = ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE


@dataclass(frozen=True)
class Topic:
    """One topic of a node. meaning: contents, units and frame in one line."""

    name: str
    kind: Any
    qos: QoSProfile
    meaning: str


def reliable(depth: int) -> QoSProfile:
    """Return the profile of a stream of which no message may be lost."""
    return QoSProfile(depth=depth)


def latched() -> QoSProfile:
    """Return the profile of a value whose latest message is also sent to later subscribers."""
    return QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def best_effort(depth: int) -> QoSProfile:
    """Return the profile of a stream that may lose messages; it matches every publisher."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


CAMERA_INFO = Topic("camera_info", CameraInfo, latched(), "calibration: K, distortion, size in px")


def mismatch(publisher: QoSProfile, subscription: QoSProfile) -> str:
    """Return why a publisher and a subscription do not connect, an empty text where they do.

    Deadline and liveliness are not compared: no node requests them, and the graph reports other values than those set.
    """
    if publisher.reliability == _BEST_EFFORT and subscription.reliability == ReliabilityPolicy.RELIABLE:
        return "the publisher is best effort, the subscription requests reliable"
    if publisher.durability == _VOLATILE and subscription.durability == DurabilityPolicy.TRANSIENT_LOCAL:
        return "the publisher is volatile, the subscription requests transient local (latched)"
    return ""
