"""ROS messages of the back-end, to and from its plain types.

Points are published in the object frame, whose z axis is the spin axis; those of `OrbitEstimate` are aligned with the
camera at t0. `transform_message` transforms the published points to the camera frame at any time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from esfo_msgs import msg
from geometry_msgs.msg import Point, Quaternion, TransformStamped, TwistWithCovarianceStamped, Vector3
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import ColorRGBA, Header
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from esfo_core.activity import Activity, ActivityError
from esfo_core.estimate import WITH_MOTION, Alternative, OrbitEstimate, RateEstimate, Status
from esfo_core.orbit import OrbitError, Spin, object_frame, rotation, tangent_basis
from esfo_core.tracks import Tracks, TrackUpdate

POINT_DTYPE = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rms_px", "<f4"), ("rows", "<u4")])
"""One published point: object frame, in units of the estimate's scale; its reprojection error; its observations."""

_STATUS: Mapping[Status, int] = {
    "ok": msg.OrbitEstimate.STATUS_OK,
    "degenerate": msg.OrbitEstimate.STATUS_DEGENERATE,
    "failed": msg.OrbitEstimate.STATUS_FAILED,
}


def update_from(message: msg.FeatureTracks) -> TrackUpdate:
    """Return the observations. Raises TracksError for columns of unequal length or impossible values."""
    uv = np.stack([np.asarray(message.u, np.float32), np.asarray(message.v, np.float32)], axis=1)
    rows = Tracks.from_columns(message.track_id, message.t, uv, message.sigma)
    return TrackUpdate(rows, np.array(message.ended, np.uint32))


def activity_from(message: msg.EventActivity) -> Activity:
    """Return the event counts. Raises ActivityError when their number does not fit the grid."""
    counts = np.array(message.counts, np.uint16)
    cells = 2 * message.rows * message.columns
    if cells == 0 or len(counts) % cells or message.bin <= 0:
        raise ActivityError(
            f"{len(counts)} counts in bins of {message.bin} ns do not fit a grid of {message.rows}x{message.columns}"
        )
    return Activity(message.t0, message.bin, message.cell, counts.reshape(-1, 2, message.rows, message.columns))


def _rate(rate_hz: float, std_hz: float) -> RateEstimate | None:
    return None if math.isnan(rate_hz) else RateEstimate(rate_hz, std_hz)


def estimate_messages(estimate: OrbitEstimate, header: Header, object_frame_id: str) -> Iterator[tuple[str, Any]]:
    """Return topic and message of each part of an estimate; `orbit` is the last, after the others are complete.

    The header has the host time of t_last and names the camera frame.
    """
    spin = estimate.spin
    if spin is not None:
        yield "spin_rate", twist_message(estimate, spin, header)
        yield "points", points_message(estimate, spin, Header(stamp=header.stamp, frame_id=object_frame_id))
    yield "markers", markers_message(spin, header)
    yield "orbit", orbit_message(estimate, header)


def orbit_message(estimate: OrbitEstimate, header: Header) -> msg.OrbitEstimate:
    """Return all of an estimate except its points; the header has the host time of t_last, in the camera frame."""
    message = msg.OrbitEstimate(
        header=header,
        status=_STATUS[estimate.status],
        flags=list(estimate.flags),
        reason=estimate.reason,
        level=estimate.level,
        rate_hz=estimate.rate_hz,
        rate_std_hz=estimate.rate_std_hz,
        stream_rate_hz=math.nan if estimate.stream_rate is None else estimate.stream_rate.rate_hz,
        stream_rate_std_hz=math.nan if estimate.stream_rate is None else estimate.stream_rate.std_hz,
        track_rate_hz=math.nan if estimate.track_rate is None else estimate.track_rate.rate_hz,
        track_rate_std_hz=math.nan if estimate.track_rate is None else estimate.track_rate.std_hz,
        rate_slope_hz_s=estimate.rate_slope_hz_s,
        rate_slope_std_hz_s=estimate.rate_slope_std_hz_s,
        axis_covariance=estimate.axis_cov.ravel(),
        scale=estimate.scale,
        points=len(estimate.points),
        tracks=estimate.tracks,
        observations=estimate.observations,
        revolutions=estimate.revolutions,
        rms_px=estimate.rms_px,
        initialisation=estimate.initialisation,
        t_first=estimate.t_first,
        t_last=estimate.t_last,
        alternative_kind=[a.kind for a in estimate.alternatives],
        alternative_rate_hz=[a.rate_hz for a in estimate.alternatives],
        alternative_axis=[v for a in estimate.alternatives for v in a.axis.tolist()],
        alternative_score_ratio=[a.score_ratio for a in estimate.alternatives],
        timing_stage=list(estimate.timing_s),
        timing_s=list(estimate.timing_s.values()),
    )
    if estimate.spin is not None:
        _fill_motion(message, estimate.spin, estimate.t_last)
    return message


def _fill_motion(message: msg.OrbitEstimate, spin: Spin, t: int) -> None:
    message.axis, message.center = spin.axis, spin.center
    message.t0, message.phase = spin.t0, float(spin.angle(np.asarray(t))) % (2 * math.pi)
    try:
        orbit = spin.paper_orbit()
    except OrbitError:
        return  # the axis passes through the camera: radius 0 means no orbit
    message.radius, message.n, message.u, message.c = orbit.radius, orbit.normal, orbit.u, orbit.c
    q = quaternion(orbit.R0)
    message.r0 = np.array([q.x, q.y, q.z, q.w])


def estimate_from(message: msg.OrbitEstimate, points: PointCloud2 | None) -> OrbitEstimate:
    """Return the estimate of an `orbit` message and of the `points` that belong to it (float32), None without any.

    Raises KeyError for an unknown status.
    """
    status = {number: name for name, number in _STATUS.items()}[message.status]
    spin = None
    X, rms, rows = np.empty((0, 3)), np.empty(0), np.empty(0, np.int64)
    if message.level in WITH_MOTION:
        spin = Spin(np.array(message.axis), float(message.rate_hz), np.array(message.center), int(message.t0))
        if points is not None:
            cloud = np.frombuffer(points.data, POINT_DTYPE)
            X = np.stack([cloud["x"], cloud["y"], cloud["z"]], axis=1).astype(np.float64) @ object_frame(spin.axis).T
            rms, rows = cloud["rms_px"].astype(np.float64), cloud["rows"].astype(np.int64)
    axes = np.array(message.alternative_axis, np.float64).reshape(-1, 3)
    alternatives = zip(
        message.alternative_kind, message.alternative_rate_hz, axes, message.alternative_score_ratio, strict=True
    )
    return OrbitEstimate(
        status=status,
        flags=tuple(message.flags),
        reason=message.reason,
        spin=spin,
        level=message.level,
        rate_hz=message.rate_hz,
        rate_std_hz=message.rate_std_hz,
        stream_rate=_rate(message.stream_rate_hz, message.stream_rate_std_hz),
        track_rate=_rate(message.track_rate_hz, message.track_rate_std_hz),
        rate_slope_hz_s=message.rate_slope_hz_s,
        rate_slope_std_hz_s=message.rate_slope_std_hz_s,
        axis_cov=np.array(message.axis_covariance).reshape(2, 2),
        points=X,
        point_rms_px=rms,
        point_observations=rows,
        tracks=message.tracks,
        observations=message.observations,
        revolutions=message.revolutions,
        rms_px=message.rms_px,
        initialisation=message.initialisation,
        scale=message.scale,
        t_first=message.t_first,
        t_last=message.t_last,
        alternatives=tuple(Alternative(*a) for a in alternatives),
        timing_s=dict(zip(message.timing_stage, message.timing_s, strict=True)),
    )


def twist_message(estimate: OrbitEstimate, spin: Spin, header: Header) -> TwistWithCovarianceStamped:
    """Return the angular velocity in rad/s with its covariance, in the camera frame.

    The linear part is zero: the object frame's origin is on the axis and does not move.
    """
    w = 2 * math.pi * spin.rate_hz
    tangent = tangent_basis(spin.axis)
    covariance = np.zeros((6, 6))
    covariance[3:, 3:] = (2 * math.pi * estimate.rate_std_hz) ** 2 * np.outer(spin.axis, spin.axis)
    covariance[3:, 3:] += w**2 * tangent @ estimate.axis_cov @ tangent.T
    message = TwistWithCovarianceStamped(header=header)
    message.twist.twist.angular = _vector(w * spin.axis)
    message.twist.covariance = covariance.ravel()
    return message


def points_message(estimate: OrbitEstimate, spin: Spin, header: Header) -> PointCloud2:
    """Return the points in the object frame, which the header names."""
    cloud = np.empty(len(estimate.points), POINT_DTYPE)
    X = estimate.points @ object_frame(spin.axis)
    for i, name in enumerate("xyz"):
        cloud[name] = X[:, i]
    cloud["rms_px"], cloud["rows"] = estimate.point_rms_px, estimate.point_observations
    kinds = {"f": PointField.FLOAT32, "u": PointField.UINT32}
    fields = [
        PointField(name=name, offset=4 * i, datatype=kinds[cloud.dtype[i].kind], count=1)
        for i, name in enumerate(cloud.dtype.names or ())
    ]
    return PointCloud2(
        header=header,
        height=1,
        width=len(cloud),
        fields=fields,
        is_bigendian=False,
        point_step=POINT_DTYPE.itemsize,
        row_step=cloud.nbytes,
        data=cloud.tobytes(),
        is_dense=True,
    )


def transform_message(spin: Spin, t: int, header: Header, object_frame_id: str) -> TFMessage:
    """Return the pose of the object frame in the camera frame at sensor time `t` ns."""
    transform = TransformStamped(header=header, child_frame_id=object_frame_id)
    R = rotation(spin.axis, float(spin.angle(np.asarray(t)))) @ object_frame(spin.axis)
    transform.transform.rotation = quaternion(R)
    transform.transform.translation = _vector(spin.center)
    return TFMessage(transforms=[transform])


def markers_message(spin: Spin | None, header: Header) -> MarkerArray:
    """Return the axis (arrow) and the camera's orbit about the object at t0 (circle), replacing all earlier markers."""
    markers = MarkerArray(markers=[Marker(header=header, action=Marker.DELETEALL)])
    if spin is None:
        return markers
    half = 0.5 * float(np.linalg.norm(spin.center)) * spin.axis
    axis = _marker(header, 0, Marker.ARROW, (1.0, 0.55, 0.0), [spin.center - half, spin.center + half])
    thickness = 0.01 * float(np.linalg.norm(spin.center))
    axis.scale = Vector3(x=thickness, y=3 * thickness, z=0.0)
    markers.markers.append(axis)
    try:
        orbit = spin.paper_orbit()
    except OrbitError:
        return markers  # the axis passes through the camera: there is no orbit to draw
    times = np.linspace(0.0, 1.0 / spin.rate_hz, 97)
    circle = [orbit.camera_center(float(t)) + spin.center for t in times]
    markers.markers.append(_marker(header, 1, Marker.LINE_STRIP, (0.34, 0.61, 1.0), circle))
    markers.markers[-1].scale = Vector3(x=thickness / 2, y=0.0, z=0.0)
    return markers


def quaternion(R: NDArray[np.float64]) -> Quaternion:
    """Return a rotation matrix (3, 3) as unit quaternion with w >= 0.

    From the eigenvector of the largest eigenvalue of a symmetric 4x4 matrix, which has no singular rotation
    (Bar-Itzhack, Journal of Guidance 2000).
    """
    (a, b, c), (d, e, f), (g, h, i) = R
    K = np.array(
        [
            [a - e - i, b + d, c + g, h - f],
            [b + d, e - a - i, f + h, c - g],
            [c + g, f + h, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    q = np.linalg.eigh(K)[1][:, -1]
    x, y, z, w = (q if q[3] >= 0 else -q).tolist()
    return Quaternion(x=x, y=y, z=z, w=w)


def _marker(header: Header, number: int, kind: int, colour: tuple[float, float, float], points: list[Any]) -> Marker:
    marker = Marker(header=header, ns="orbit", id=number, type=kind, action=Marker.ADD)
    marker.pose.orientation.w = 1.0
    marker.color = ColorRGBA(r=colour[0], g=colour[1], b=colour[2], a=1.0)
    marker.points = [Point(x=float(p[0]), y=float(p[1]), z=float(p[2])) for p in points]
    return marker


def _vector(v: NDArray[np.float64]) -> Vector3:
    return Vector3(x=float(v[0]), y=float(v[1]), z=float(v[2]))
