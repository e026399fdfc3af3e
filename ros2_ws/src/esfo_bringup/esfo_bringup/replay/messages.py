"""ROS messages of the replay."""

from __future__ import annotations

from array import array

import numpy as np
from esfo_msgs.msg import EventActivity
from event_camera_msgs.msg import EventPacket
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from esfo_core.camera import Camera
from esfo_core.codecs import encode_mono
from esfo_core.events import EventArray
from esfo_ros.time_stamps import to_stamp


def packet_message(events: EventArray, seq: int, size: tuple[int, int], frame_id: str) -> EventPacket:
    """Return a packet of events (N,), N > 0; the stamp is the sensor time of the first. size: (width, height), px."""
    t = int(events["t"][0])
    return EventPacket(
        header=Header(stamp=to_stamp(t), frame_id=frame_id),
        width=size[0],
        height=size[1],
        seq=seq,
        time_base=t,
        encoding="mono",
        is_bigendian=False,
        events=array("B", encode_mono(events, t)),
    )


def camera_info_message(camera: Camera, frame_id: str) -> CameraInfo:
    """Return the calibration of a camera whose images are not rectified."""
    P = np.zeros((3, 4))
    P[:, :3] = camera.K
    return CameraInfo(
        header=Header(frame_id=frame_id),
        width=camera.width,
        height=camera.height,
        distortion_model=camera.distortion_model,
        d=camera.D.tolist(),
        k=camera.K.ravel(),
        r=np.eye(3).ravel(),
        p=P.ravel(),
    )


def clock_message(t: int) -> Clock:
    """Return a clock message of the time `t` ns."""
    return Clock(clock=to_stamp(t))


def acknowledged_until(message: EventActivity) -> int:
    """Return the sensor time in ns before which the front-end has processed every event."""
    bins = len(message.counts) // (2 * message.rows * message.columns)
    return int(message.t0 + bins * message.bin)
