"""ROS node of the front-end: event packets in, corner clusters, feature tracks and event activity out."""

from __future__ import annotations

import sys
from dataclasses import asdict
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from esfo_msgs.msg import CornerClusters, EventActivity, FeatureTracks, OrbitEstimate
from event_camera_msgs.msg import EventPacket
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from esfo_core.camera import Camera
from esfo_core.errors import CameraError
from esfo_core.node import declare_fields, declare_options, diagnostics, run, start_worker, trigger
from esfo_core.orbit import Spin
from esfo_core.recordings.messages import camera_from_info
from esfo_frontend import messages
from esfo_frontend.frontend import FrontendOutput
from esfo_frontend.live import LiveFrontend, LiveOptions
from esfo_frontend.options import PRESETS
from esfo_frontend.overlay import Overlay, screw_line
from esfo_frontend.warm_up import warm_up

RELIABLE = QoSProfile(depth=100)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class FrontendNode(Node):  # type: ignore[misc]
    """Callbacks queue packets; one worker thread decodes, tracks and publishes."""

    def __init__(self) -> None:
        super().__init__("frontend")
        options, live = declare_options(self, PRESETS), declare_fields(self, LiveOptions())
        self.get_logger().info("compiling")
        warm_up(options)
        self._live = LiveFrontend(options)
        self._frame_id = ""
        self._spin: Spin | None = None
        self._camera: Camera | None = None
        self._overlay: Overlay | None = None
        self._health = self._live.health(dropped=0)
        self._clusters = self.create_publisher(CornerClusters, "corner_clusters", RELIABLE)
        self._tracks = self.create_publisher(FeatureTracks, "feature_tracks", RELIABLE)
        self._activity = self.create_publisher(EventActivity, "event_activity", RELIABLE)
        self._image = self.create_publisher(Image, "overlay", 1)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.worker = start_worker(self, self._process, live.queue)
        self.worker.when_idle(live.idle_flush_s, self._flush)
        self.create_service(Trigger, "~/flush", trigger(self, partial(self.worker.request, self._flush)))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(0.2, self._draw, clock=steady)
        self.create_timer(1.0, self._diagnose, clock=steady)
        self.create_subscription(OrbitEstimate, "orbit", self._on_orbit, LATCHED)
        self.create_subscription(CameraInfo, "camera_info", self._on_camera, LATCHED)
        self._connecting = self.create_timer(0.05, partial(self._connect, live), clock=steady)

    def _connect(self, live: LiveOptions) -> None:
        """Take events, once the back-end is there if it has to be: whoever sends them sees that all is ready."""
        if live.wait_for_back_end and not self._back_end_listens(live.min_listeners):
            return
        self._connecting.cancel()
        reliability = ReliabilityPolicy[live.events.reliability.upper()]
        qos = QoSProfile(depth=live.events.depth, reliability=reliability)
        self.create_subscription(EventPacket, "events", self._on_packet, qos)
        self.get_logger().info("ready")

    def _back_end_listens(self, least: int) -> bool:
        """Whether a node that publishes `orbit` gets tracks and activity, and so does every other known listener.

        least: listeners that there must be; one whose announcement got lost is not known for some seconds.
        """
        orbit = self.get_publishers_info_by_topic(self.resolve_topic_name("orbit"))
        back_ends = {(info.node_namespace, info.node_name) for info in orbit}
        for publisher in (self._tracks, self._activity):
            known = self.get_subscriptions_info_by_topic(publisher.topic_name)
            listeners = {(info.node_namespace, info.node_name) for info in known}
            if not back_ends & listeners or publisher.get_subscription_count() < max(least, len(known)):
                return False
        return True

    def _on_packet(self, message: EventPacket) -> None:
        self._live.arrived(message.seq)
        self.worker.put(message)

    def _on_orbit(self, message: OrbitEstimate) -> None:
        self._spin = messages.spin_from(message)

    def _on_camera(self, message: CameraInfo) -> None:
        try:
            self._camera = camera_from_info(message)
        except CameraError as error:
            self.get_logger().error(f"camera_info: {error}")

    def _process(self, message: EventPacket) -> None:
        self._frame_id = message.header.frame_id
        for output in self._live.process(messages.packet_from(message)):
            self._publish(output)
        if self._overlay is not None and self._overlay.size == self._live.size:
            self._overlay.add(self._live.events)

    def _flush(self) -> str:
        for output in self._live.flush():
            self._publish(output)
        totals = self._live.totals
        return f"packets={totals.packets} observations={totals.observations} activity_bins={totals.activity_bins}"

    def _publish(self, output: FrontendOutput) -> None:
        offset, frame_id, rows = self._live.offset, self._frame_id, output.tracks.observations
        if len(output.clusters):
            header = messages.header_at(int(output.clusters.t.max()) + offset, frame_id)
            self._clusters.publish(messages.clusters_message(output.clusters, header))
        if len(rows) or len(output.tracks.ended):
            header = messages.header_at((int(rows.t.max()) if len(rows) else self._live.last_t) + offset, frame_id)
            self._tracks.publish(messages.tracks_message(output.tracks, header))
        if output.activity is not None:
            for message in messages.activity_messages(output.activity, offset, frame_id):
                self._activity.publish(message)

    def _draw(self) -> None:
        """Publish what gathered since the last time; gather only while somebody looks."""
        overlay = self._overlay
        wanted = self._image.get_subscription_count() > 0 and self._live.size != (0, 0)
        self._overlay = Overlay(*self._live.size) if wanted else None
        if wanted and overlay is not None and overlay.events:
            picture = overlay.picture(screw_line(self._spin, self._camera))
            header = messages.header_at(self._live.last_t + self._live.offset, self._frame_id)
            self._image.publish(messages.image_message(picture, header))

    def _diagnose(self) -> None:
        before, self._health = self._health, self._live.health(self.worker.dropped)
        problem = self._health.problems_since(before, self._live.problem)
        if problem:
            self.get_logger().warning(problem)
        values = {
            "Mev/s in": (self._health.events - before.events) / 1e6,
            "packets": self._live.totals.packets,
            "observations": self._live.totals.observations,
            "tracks alive": len(self._live.totals.alive),
            "image speed px/s": round(self._live.image_speed, 1),
            "queue age s": round(self.worker.age, 3),
        }
        self._diagnostics.publish(diagnostics(self, problem, values | asdict(self._health)))


def main() -> None:
    """Run the node."""
    sys.exit(run(FrontendNode))


if __name__ == "__main__":
    main()
