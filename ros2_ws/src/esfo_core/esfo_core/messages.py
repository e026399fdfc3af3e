"""What the nodes say alike: time stamps, topics and the quality of service they ask for, parameters, diagnostics."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo

from esfo_core.errors import EsfoError
from esfo_core.options import OptionField

SECOND = 1_000_000_000

_BEST_EFFORT, _VOLATILE = ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE


@dataclass(frozen=True)
class Topic:
    """One topic of a node. meaning: contents, units and frame in one line."""

    name: str
    kind: Any
    qos: QoSProfile
    meaning: str


@dataclass(frozen=True)
class Service:
    """One service of a node, of type std_srvs/Trigger, and what it does.

    after_quiet: it waits until everything that is on the way has been worked on; otherwise it comes next.
    """

    name: str
    meaning: str
    after_quiet: bool


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


def to_stamp(ns: int) -> Time:
    """Return nanoseconds as a ROS time. Raises EsfoError for a time that ROS cannot express."""
    seconds, nanoseconds = divmod(ns, SECOND)
    if not 0 <= seconds < 2**31:
        raise EsfoError(f"time {ns} ns does not fit a ROS time stamp")
    return Time(sec=seconds, nanosec=nanoseconds)


def from_stamp(stamp: Time) -> int:
    """Return a ROS time in nanoseconds."""
    return int(stamp.sec) * SECOND + int(stamp.nanosec)


def parameter_descriptor(leaf: OptionField, read_only: bool) -> ParameterDescriptor:
    """Describe an option as a parameter, with its meaning and its range or choices."""
    # Typed dynamically, so that `300` is taken where `300.0` is meant: rclpy would refuse it.
    descriptor = ParameterDescriptor(
        description=leaf.meaning,
        read_only=read_only,
        dynamic_typing=True,
        additional_constraints=f"one of: {', '.join(leaf.choices)}" if leaf.choices else "",
    )
    low = -sys.float_info.max if leaf.low is None else leaf.low
    high = sys.float_info.max if leaf.high is None else leaf.high
    if leaf.low is not None or leaf.high is not None:
        if isinstance(leaf.value, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
        else:
            bounds = [round(max(min(v, 2.0**62), -(2.0**62))) for v in (low, high)]
            descriptor.integer_range = [IntegerRange(from_value=bounds[0], to_value=bounds[1], step=1)]
    return descriptor


def diagnostic_message(
    name: str, stamp: Time, problems: Mapping[str, str], values: Mapping[str, object]
) -> DiagnosticArray:
    """Build a diagnostic message of one status: OK without problems, else a warning that says all of them."""
    status = DiagnosticStatus(
        level=DiagnosticStatus.WARN if problems else DiagnosticStatus.OK,
        name=name,
        message="; ".join(problems.values()) or "ok",
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
    message = DiagnosticArray(status=[status])
    message.header.stamp = stamp
    return message
