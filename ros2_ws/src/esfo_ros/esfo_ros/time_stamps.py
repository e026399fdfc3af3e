"""Conversion between ROS time stamps and nanoseconds."""

from __future__ import annotations

from builtin_interfaces.msg import Time

from esfo_core.errors import EsfoError
from esfo_core.events import NS_PER_S


def to_stamp(ns: int) -> Time:
    """Return nanoseconds as a ROS time. Raises EsfoError for a time that a ROS stamp cannot hold."""
    seconds, nanoseconds = divmod(ns, NS_PER_S)
    if not 0 <= seconds < 2**31:
        raise EsfoError(f"time {ns} ns does not fit a ROS time stamp")
    return Time(sec=seconds, nanosec=nanoseconds)


def from_stamp(stamp: Time) -> int:
    """Return a ROS time in nanoseconds."""
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)
