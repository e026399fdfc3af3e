"""Topics of the nodes: type, quality of service, and why two ends do not connect."""

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
    """Return the profile of a stream of which nothing may be lost."""
    return QoSProfile(depth=depth)


def latched() -> QoSProfile:
    """Return the profile of a value whose latest message also reaches those that come later."""
    return QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def best_effort(depth: int) -> QoSProfile:
    """Return the profile of a stream that matches every publisher, and of which some may be lost."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


CAMERA_INFO = Topic("camera_info", CameraInfo, latched(), "calibration: K, distortion, size in px")


def mismatch(publisher: QoSProfile, subscription: QoSProfile) -> str:
    """Say why two ends of a topic do not connect; empty when they do.

    Nothing here asks for deadlines or liveliness, of which the graph reports other values than those that were set.
    """
    if publisher.reliability == _BEST_EFFORT and subscription.reliability == ReliabilityPolicy.RELIABLE:
        return "it is published best effort and asked for reliably"
    if publisher.durability == _VOLATILE and subscription.durability == DurabilityPolicy.TRANSIENT_LOCAL:
        return "it is published volatile and asked for transient local (latched)"
    return ""
