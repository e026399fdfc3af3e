"""Writes the result of an offline run as the messages that the back-end publishes in a live run.

The motion is known only at the end of the run, but for all times: orbit, spin rate, markers and calibration are written
at the beginning and at the end of the bag, pose and points over its whole length.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from esfo_backend.ros.live_backend import BackendNodeOptions, verdict_values
from esfo_backend.ros.messages import estimate_messages, points_message, transform_message
from esfo_backend.ros.node import TF_PERIOD_S, BackendNode
from esfo_bringup.offline.pipeline import RunResult
from esfo_bringup.offline.source import Source
from esfo_bringup.replay.messages import camera_info_message
from esfo_bringup.replay.player import ReplayOptions
from esfo_bringup.result_bag.message_bag import MessageBag
from esfo_core.estimate import OrbitEstimate
from esfo_core.events import NS_PER_S
from esfo_core.tracks import Tracks
from esfo_frontend.overlay import TRAIL_NS, compose, line_pixels, screw_line
from esfo_frontend.ros.messages import header_at, image_message
from esfo_ros.diagnostics import diagnostic_message
from esfo_ros.time_stamps import to_stamp

TF_NS = round(TF_PERIOD_S * NS_PER_S)
POINTS_NS = 3 * TF_NS
"""Viewers place a cloud at its stamp only: it is repeated, so that it turns in them."""

CAMERA_FRAME, OBJECT_FRAME = ReplayOptions().frame_id, BackendNodeOptions().object_frame


def write_outcome(
    bag: MessageBag,
    result: RunResult,
    source: Source,
    frames: Iterable[tuple[int, NDArray[np.uint8]]],
    span: tuple[int, int],
) -> None:
    """Write the topics of the back-end, the calibration and the overlay.

    frames: ends of periods, ns, each with the levels of its `Canvas`. span: times of the first and the last event, ns.
    """
    first, last = span
    estimate = replace(result.estimate, timing_s={})  # the bag must not depend on how long the run takes
    end = max(last, estimate.t_last)
    bag.add_topics(BackendNode.OUTPUTS)
    _write_estimate(bag, estimate, source, first, last)
    _write_turning(bag, estimate, first, end)
    _write_overlay(bag, result, source, frames, last)
    _write_estimate(bag, estimate, source, end, last)


def _write_estimate(bag: MessageBag, estimate: OrbitEstimate, source: Source, t: int, last: int) -> None:
    if not source.assumed:  # a guess is not published as a calibration
        bag.publish("camera_info", t, camera_info_message(source.camera, CAMERA_FRAME))
    header = header_at(estimate.t_last or last, CAMERA_FRAME)
    for topic, message in estimate_messages(estimate, header, OBJECT_FRAME):
        if topic != "points" or t >= estimate.t_last:  # points at a later time would have no pose yet
            bag.publish(topic, t, message)
    verdict = diagnostic_message("/backend", to_stamp(t), {}, verdict_values(estimate))
    bag.publish("/diagnostics", t, verdict)


def _write_turning(bag: MessageBag, estimate: OrbitEstimate, first: int, end: int) -> None:
    """Write the pose and the points over time."""
    spin = estimate.spin
    if spin is None:
        return
    for t in sorted({*range(first, end, TF_NS), estimate.t_last, end}):
        bag.publish("/tf", t, transform_message(spin, t, header_at(t, CAMERA_FRAME), OBJECT_FRAME))
    cloud = points_message(estimate, spin, header_at(first, OBJECT_FRAME))
    for t in range(first, end, POINTS_NS):
        cloud.header.stamp = to_stamp(t)
        bag.publish("points", t, cloud)


def _write_overlay(
    bag: MessageBag, result: RunResult, source: Source, frames: Iterable[tuple[int, NDArray[np.uint8]]], last: int
) -> None:
    camera = result.estimate.camera(source.camera)
    line = line_pixels(screw_line(result.estimate.spin, camera), camera.width, camera.height)
    tracks = result.tracks.select(np.argsort(result.tracks.t, kind="stable"))
    for end, levels in frames:
        t = min(end, last)
        picture = compose(levels, _between(tracks, t - TRAIL_NS, t), line)
        bag.publish("overlay", t, image_message(picture, header_at(t, CAMERA_FRAME)))


def _between(tracks: Tracks, after: int, until: int) -> Tracks:
    """Rows of tracks, ordered by time, with times in (after, until]."""
    low, high = np.searchsorted(tracks.t, [after, until], side="right")
    return tracks.select(np.arange(low, high))
