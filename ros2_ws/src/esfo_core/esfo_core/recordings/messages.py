"""The ROS messages of a recording: `event_camera_msgs/EventPacket` and `sensor_msgs/CameraInfo`."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from esfo_core.camera import Camera
from esfo_core.events import NS_PER_S
from esfo_core.packets import EVENT_PACKET, OLD_EVENT_PACKET

CAMERA_INFO = "sensor_msgs/msg/CameraInfo"

_EVENT_PACKET_DEFINITION = """\
std_msgs/Header header
uint32 height
uint32 width
uint64 seq
uint64 time_base
string encoding
bool is_bigendian
uint8[] events
"""


@cache
def typestore(ros1: bool = False) -> Any:
    """Return the message types of ROS 1 Noetic or ROS 2 Jazzy with `EventPacket` among them, under both its names."""
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    for kind in (EVENT_PACKET, OLD_EVENT_PACKET):
        store.register(get_types_from_msg(_EVENT_PACKET_DEFINITION, kind))
    return store


def camera_from_info(info: Any) -> Camera | None:
    """Return the camera of a ROS 1 or ROS 2 `CameraInfo`; None where it is uncalibrated (K[0] = 0, as ROS defines).

    A distortion model of `none`, or no name, with coefficients of zero is a pinhole.

    Raises CameraError for impossible values.
    """
    upper = hasattr(info, "K")
    K, D = (info.K, info.D) if upper else (info.k, info.d)
    if K[0] == 0.0:
        return None
    model, coefficients = str(info.distortion_model), np.array(D, np.float64)
    if model in ("", "none") and not coefficients.any():
        model, coefficients = "plumb_bob", np.zeros(0)
    matrix = np.array(K, np.float64).reshape(3, 3)
    return Camera(int(info.width), int(info.height), matrix, model or "plumb_bob", coefficients)


def info_from_camera(camera: Camera, stamp_ns: int, frame_id: str) -> Any:
    """Return the ROS 2 `CameraInfo` of a camera without rectification."""
    types = typestore().types
    P = np.zeros((3, 4))
    P[:, :3] = camera.K
    return types[CAMERA_INFO](
        header=header(stamp_ns, frame_id),
        height=camera.height,
        width=camera.width,
        distortion_model=camera.distortion_model,
        d=camera.D,
        k=camera.K.ravel(),
        r=np.eye(3).ravel(),
        p=P.ravel(),
        binning_x=0,
        binning_y=0,
        roi=types["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
    )


def header(stamp_ns: int, frame_id: str) -> Any:
    """Return a ROS 2 `std_msgs/Header` with the time in ns."""
    types = typestore().types
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def stamp_of(message: Any) -> int:
    """Return the host time in ns in the header of a ROS 1 or ROS 2 message."""
    stamp = message.header.stamp
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)
