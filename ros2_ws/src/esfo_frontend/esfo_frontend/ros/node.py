"""ROS node of the front-end: event packets in, corner clusters, feature tracks and event activity out."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from typing import Any

from esfo_msgs.msg import CornerClusters, EventActivity, FeatureTracks, OrbitEstimate
from event_camera_msgs.msg import EventPacket
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image

from esfo_core.camera import Camera
from esfo_core.errors import CameraError, RecordingError
from esfo_core.orbit import Spin
from esfo_core.packets import SUPPORTED, packet_from_cdr, sequence_of
from esfo_core.recordings.messages import camera_from_info
from esfo_frontend.frontend import FrontendOutput
from esfo_frontend.online.live_frontend import FrontendNodeOptions, LiveFrontend, SubscriptionOptions
from esfo_frontend.options import PRESETS, FrontendOptions, check_for_sensor, check_options
from esfo_frontend.overlay import Overlay, screw_line
from esfo_frontend.ros import messages
from esfo_frontend.warm_up import warm_up
from esfo_ros.entry_point import run
from esfo_ros.lifecycle_node import DIAGNOSE_S, ManagedNode
from esfo_ros.services import Service
from esfo_ros.topics import CAMERA_INFO, Topic, best_effort, latched, reliable
from esfo_ros.worker import Worker

CONNECT_S, FOLLOW_S, DRAW_S = 0.05, 1.0, 0.2

EVENTS = Topic("events", EventPacket, best_effort(1000), "event packets or event arrays; px, sensor time")
ORBIT = Topic("orbit", OrbitEstimate, latched(), "motion, drawn in the overlay")
CLUSTERS = Topic("corner_clusters", CornerClusters, reliable(100), "corners: px, sensor time in ns, cluster id")
TRACKS = Topic("feature_tracks", FeatureTracks, reliable(100), "observations of tracks: id, sensor time in ns, px")
ACTIVITY = Topic("event_activity", EventActivity, reliable(1000), "event counts by time bin, polarity and cell")
OVERLAY = Topic(
    "overlay", Image, reliable(1), "rgb8: events, tracks, projected spin axis; only while it has subscribers"
)


class FrontendNode(ManagedNode[FrontendOptions, FrontendNodeOptions]):
    """Callbacks queue packets; one worker thread decodes, tracks and publishes."""

    INPUTS = (EVENTS, CAMERA_INFO, ORBIT)
    OUTPUTS = (CLUSTERS, TRACKS, ACTIVITY, OVERLAY)
    SERVICES = (
        Service(
            "~/flush",
            "processes all queued packets, ends every track, publishes; returns `packets=.. observations=.. "
            "activity_bins=..`",
            after_quiet=True,
        ),
        Service("~/reset", "deletes the stream and its tracks", after_quiet=False),
    )

    def __init__(self) -> None:
        self._stream = LiveFrontend(PRESETS["default"])
        self._overlay: Overlay | None = None
        super().__init__("frontend", PRESETS, FrontendNodeOptions())

    def check(self, options: FrontendOptions) -> None:
        """Raise OptionError for options that contradict each other, or the sensor whose events come."""
        check_options(options)
        if self._stream.size != (0, 0):
            check_for_sensor(options, *self._stream.size)

    def configure(self) -> Worker[Any]:
        """Compile all kernels and make the front-end."""
        self.get_logger().info("compiling")
        warm_up(self.options)
        self._stream.camera_frame = self.live.camera_frame
        self._stream.configure(self.options)
        self._kind: str | None = None
        self._asked: SubscriptionOptions | None = None
        self._spin: Spin | None = None
        self._camera: Camera | None = None
        self._complaint = ""
        self._earlier = self._stream.health(dropped=0)
        self._new_events = 0
        worker = self.make_worker(self._process, self.live.queue)
        worker.when_idle(self.live.idle_flush_s, self._flush)
        return worker

    def activate(self) -> None:
        """Subscribe to the events, after the back-end is present if `wait_for_back_end` is set."""
        self._kind = None
        self._stream.resume()
        self.tick(DRAW_S, self._draw)
        self.subscribe(ORBIT, self._on_orbit)
        self.subscribe_latched_or_not(CAMERA_INFO, self._on_camera)
        self._connecting = self.tick(CONNECT_S, self._connect)

    def clean_up(self) -> None:
        """Forget the stream; ids of tracks continue, because the back-end may still run."""
        self._stream.reset()
        self._spin = self._camera = self._overlay = None

    def reconfigure(self) -> None:
        """Track with other options from the next packet on."""
        self._stream.configure(self.options)
        self._stream.camera_frame = self.live.camera_frame
        if self.worker is not None:
            self.worker.capacity = self.live.queue
            self.worker.when_idle(self.live.idle_flush_s, self._flush)

    def jobs(self) -> dict[str, Callable[[], str]]:
        """Return the jobs of the services."""
        return {"~/flush": self._flush, "~/reset": self._reset}

    def _connect(self) -> None:
        """Subscribe to the events when the back-end is present: the publisher then sees that all nodes are ready."""
        if self.live.wait_for_back_end and not self._back_end_listens(self.live.min_listeners):
            return
        self._connecting.cancel()
        self._follow_publisher()
        self.tick(FOLLOW_S, self._follow_publisher)
        self.get_logger().info("ready")

    def _back_end_listens(self, least: int) -> bool:
        """Whether a node that publishes `orbit` receives tracks and activity, and so does every other known listener.

        least: listeners that there must be; one whose announcement was lost becomes known only after some seconds.
        """
        orbit = self.get_publishers_info_by_topic(self.resolve_topic_name(ORBIT.name))
        back_ends = {(info.node_namespace, info.node_name) for info in orbit}
        for topic in (TRACKS, ACTIVITY):
            known = self.get_subscriptions_info_by_topic(self.resolve_topic_name(topic.name))
            listeners = {(info.node_namespace, info.node_name) for info in known}
            if not back_ends & listeners or self.listeners(topic.name) < max(least, len(known)):
                return False
        return True

    def _follow_publisher(self) -> None:
        """Subscribe to the type of message that is published, with the quality of service that is asked for."""
        known = self.get_publishers_info_by_topic(self.resolve_topic_name(EVENTS.name))
        published = {info.topic_type for info in known}
        offered = [name for name in SUPPORTED if name in published]
        kind = self._kind if self._kind in offered or not offered else offered[0]
        self._complaint = ""
        if published and not offered:
            self._complaint = f"events are {', '.join(sorted(published))}; known: {', '.join(SUPPORTED)}"
        wanted = (kind or SUPPORTED[0], self.live.events)
        if wanted == (self._kind, self._asked):
            return
        try:
            message_type = _import(wanted[0])
        except ImportError:
            self._complaint = f"events are {wanted[0]}, whose package is not installed"
            return
        self._kind, self._asked = wanted
        reliability = ReliabilityPolicy[self._asked.reliability.upper()]
        qos = QoSProfile(depth=self._asked.depth, reliability=reliability)
        self.subscribe_raw(Topic(EVENTS.name, message_type, qos, EVENTS.meaning), partial(self._on_packet, self._kind))

    def remedy(self, topic: str) -> str:
        """As in `ConnectedNode`."""
        return "set events.reliability:=best_effort" if topic == EVENTS.name else super().remedy(topic)

    def _on_packet(self, kind: str, data: bytes) -> None:
        self._stream.arrived(sequence_of(kind, data))
        if self.worker is not None:
            self.worker.put((kind, data))

    def _on_orbit(self, message: OrbitEstimate) -> None:
        self._spin = messages.spin_from(message)

    def _on_camera(self, message: CameraInfo) -> None:
        try:
            self._camera = camera_from_info(message)
        except CameraError as error:
            self.get_logger().error(f"camera_info: {error}")

    def _process(self, packet: tuple[str, bytes]) -> None:
        try:
            read = packet_from_cdr(*packet)
        except RecordingError as error:
            self._stream.refuse(str(error))
            return
        for output in self._stream.process(read):
            self._publish(output)
        if self._overlay is not None and self._overlay.size == self._stream.size:
            self._overlay.add(self._stream.events)

    def _flush(self) -> str:
        for output in self._stream.flush():
            self._publish(output)
        totals = self._stream.totals
        return f"packets={totals.packets} observations={totals.observations} activity_bins={totals.activity_bins}"

    def _reset(self) -> str:
        self._stream.reset()
        return "the stream is forgotten"

    def _publish(self, output: FrontendOutput) -> None:
        stream = self._stream
        for topic, message in messages.output_messages(output, stream.last_t, stream.offset, stream.frame_id):
            self.publish(topic, message)
        if self._overlay is not None:
            self._overlay.add_tracks(output.tracks.observations)

    def _draw(self) -> None:
        """Publish the events since the last image; collect them only while the topic has subscribers."""
        overlay = self._overlay
        wanted = self.listeners(OVERLAY.name) > 0 and self._stream.size != (0, 0)
        self._overlay = Overlay(*self._stream.size, before=overlay) if wanted else None
        if wanted and overlay is not None and overlay.events:
            picture = overlay.picture(screw_line(self._spin, self._camera))
            header = messages.header_at(self._stream.last_t + self._stream.offset, self._stream.frame_id)
            self.publish(OVERLAY.name, messages.image_message(picture, header))

    def problems(self) -> dict[str, str]:
        """Return the faults of the stream since the last call, and what is wrong with the topic."""
        before, self._earlier = self._earlier, self._stream.health(self.worker.dropped if self.worker else 0)
        self._new_events = self._earlier.events - before.events
        found = {"events": self._complaint} if self._complaint else {}
        return found | self._earlier.problems_since(before, self._stream.problem)

    def values(self) -> dict[str, object]:
        """Return counts of the stream and the age of the queue."""
        stream, health = self._stream, self._earlier
        return {
            "Mev/s in": self._new_events / DIAGNOSE_S / 1e6,
            "packets": stream.totals.packets,
            "observations": stream.totals.observations,
            "tracks alive": len(stream.totals.alive),
            "image speed px/s": round(stream.image_speed, 1),
            "queue age s": round(self.worker.age, 3) if self.worker else 0.0,
        } | asdict(health)


def _import(kind: str) -> Any:
    """Return the class of a message type `package/msg/Name`. Raises ImportError where it is not installed."""
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def main() -> None:
    """Run the node."""
    sys.exit(run(FrontendNode, FrontendNode.spin))


if __name__ == "__main__":
    main()
