"""ROS messages of the front-end, to and from its plain types."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from typing import Any

import numpy as np
from esfo_msgs.msg import CornerClusters, EventActivity, FeatureTracks, OrbitEstimate
from numpy.typing import NDArray
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from esfo_core.activity import Activity
from esfo_core.estimate import WITH_MOTION
from esfo_core.orbit import Spin
from esfo_core.tracks import TrackUpdate
from esfo_frontend.frontend import FrontendOutput
from esfo_frontend.labelled_corners import LabelledCorners
from esfo_ros.time_stamps import to_stamp

MESSAGE_BYTES = 40_000
"""Most bytes of counts in one message: the default transport carries it without loss."""


def output_messages(output: FrontendOutput, t: int, offset_ns: int, frame_id: str) -> Iterator[tuple[str, Any]]:
    """Return the messages that an output makes, each after its topic.

    t: sensor time of the latest event, ns. offset_ns: host time minus sensor time.
    """
    rows = output.tracks.observations
    if len(output.corners):
        header = header_at(int(output.corners.t.max()) + offset_ns, frame_id)
        yield "corner_clusters", corners_message(output.corners, header)
    if len(rows) or len(output.tracks.ended):
        header = header_at((int(rows.t.max()) if len(rows) else t) + offset_ns, frame_id)
        yield "feature_tracks", tracks_message(output.tracks, header)
    activity = () if output.activity is None else (output.activity,)
    for piece in (*activity, *output.pyramid):
        for message in activity_messages(piece, offset_ns, frame_id):
            yield "event_activity", message


def corners_message(corners: LabelledCorners, header: Header) -> CornerClusters:
    """Return corners with their labels in `cluster_id`; the header has the time of the newest corner."""
    return CornerClusters(
        header=header,
        x=_flat("H", corners.x),
        y=_flat("H", corners.y),
        polarity=_flat("B", corners.polarity),
        t=_flat("q", corners.t),
        cluster_id=_flat("i", corners.label),
    )


def tracks_message(update: TrackUpdate, header: Header) -> FeatureTracks:
    """Return new observations and ended tracks; the header has the time of the newest observation."""
    rows = update.observations
    return FeatureTracks(
        header=header,
        track_id=_flat("I", rows.track_id),
        t=_flat("q", rows.t),
        u=_flat("f", rows.uv[:, 0]),
        v=_flat("f", rows.uv[:, 1]),
        sigma=_flat("f", rows.sigma),
        ended=_flat("I", update.ended),
    )


def activity_messages(activity: Activity, offset_ns: int, frame_id: str) -> Iterator[EventActivity]:
    """Return the known bins in messages of up to `MESSAGE_BYTES`; offset_ns: host time minus sensor time.

    Missing bins are not sent: a gap between two messages is missing.
    """
    _, _, rows, columns = activity.counts.shape
    most = max(MESSAGE_BYTES // activity.counts[:1].nbytes, 1)
    for first, known in ((k, part) for part in activity.known() for k in range(0, len(part.counts), most)):
        counts = known.counts[first : first + most]
        t0 = known.t0 + first * known.bin
        yield EventActivity(
            header=header_at(t0 + len(counts) * activity.bin + offset_ns, frame_id),
            t0=t0,
            bin=activity.bin,
            cell=activity.cell,
            rows=rows,
            columns=columns,
            counts=_flat("H", counts),
        )


def image_message(rgb: NDArray[np.uint8], header: Header) -> Image:
    """Return an image (height, width, 3) of red, green and blue."""
    height, width, _ = rgb.shape
    return Image(header=header, height=height, width=width, encoding="rgb8", step=3 * width, data=_flat("B", rgb))


def spin_from(message: OrbitEstimate) -> Spin | None:
    """Return the motion of an estimate, None where it has none."""
    if message.level not in WITH_MOTION:
        return None
    return Spin(np.array(message.axis), float(message.rate_hz), np.array(message.center), int(message.t0))


def header_at(ns: int, frame_id: str) -> Header:
    """Return a header with a host time in nanoseconds."""
    return Header(stamp=to_stamp(ns), frame_id=frame_id)


def _flat(typecode: str, values: NDArray[np.generic]) -> array[int]:
    # rclpy takes an array.array as it is, but walks through anything else element by element.
    return array(typecode, np.ascontiguousarray(values).tobytes())
