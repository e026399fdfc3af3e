"""ROS node of the back-end: feature tracks and event activity in, spin rate, orbit, points and pose out.

Times in the messages are sensor times; header stamps are ROS times. The latest activity message gives the difference
of the two, by which the pose in /tf is turned on with ROS time between estimates.
"""

from __future__ import annotations

import sys
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from esfo_msgs import msg
from geometry_msgs.msg import TwistWithCovarianceStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from esfo_backend import messages
from esfo_backend.live import LiveBackend, LiveOptions, summary, verdict_values
from esfo_backend.options import PRESETS
from esfo_core.estimate import OrbitEstimate
from esfo_core.node import (
    declare_fields,
    declare_options,
    diagnostics,
    from_stamp,
    run,
    start_worker,
    to_stamp,
    trigger,
)
from esfo_core.orbit import Spin
from esfo_core.recordings.messages import camera_from_info

INPUT = QoSProfile(depth=10_000)  # much comes while the worker holds the interpreter; nothing of it may be lost
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TF_PERIOD_S = 1 / 30
CLOCK_DIFFERENCE_S = 5.0


class BackendNode(Node):  # type: ignore[misc]
    """Callbacks take messages in; one worker thread solves and publishes."""

    def __init__(self) -> None:
        super().__init__("backend")
        options, live = declare_options(self, PRESETS), declare_fields(self, LiveOptions())
        self._live = LiveBackend(options)
        self._object_frame = live.object_frame
        self._camera_frame = ""
        self._offset = self._stamp = 0
        self._spin: Spin | None = None
        self._estimate: OrbitEstimate | None = None
        self._orbit = self.create_publisher(msg.OrbitEstimate, "orbit", LATCHED)
        self._spin_rate = self.create_publisher(TwistWithCovarianceStamped, "spin_rate", LATCHED)
        self._points = self.create_publisher(PointCloud2, "points", LATCHED)
        self._markers = self.create_publisher(MarkerArray, "markers", LATCHED)
        self._tf = self.create_publisher(TFMessage, "/tf", 100)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.worker = start_worker(self, self._solve_if_due, capacity=1)
        self.worker.when_idle(live.idle_solve_s, self._solve)
        self.create_service(Trigger, "~/solve", trigger(self, partial(self.worker.request, self._solve)))
        self.create_subscription(CameraInfo, "camera_info", self._on_camera, LATCHED)
        self.create_subscription(msg.FeatureTracks, "feature_tracks", self._on_tracks, INPUT)
        self.create_subscription(msg.EventActivity, "event_activity", self._on_activity, INPUT)
        self.create_timer(TF_PERIOD_S, self._turn)
        self.create_timer(1.0, self._diagnose, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.get_logger().info("ready")

    def _on_camera(self, message: CameraInfo) -> None:
        camera = camera_from_info(message)
        if camera is None:
            self.get_logger().error("camera_info is not calibrated (K is zero); waiting for another")
        else:
            self._live.set_camera(camera)

    def _on_tracks(self, message: msg.FeatureTracks) -> None:
        self._live.add_tracks(messages.update_from(message))
        self._wake()

    def _on_activity(self, message: msg.EventActivity) -> None:
        activity = messages.activity_from(message)
        self._camera_frame, self._stamp = message.header.frame_id, from_stamp(message.header.stamp)
        self._offset = self._stamp - activity.end
        restarts = self._live.restarts
        self._live.add_activity(activity)
        if self._live.restarts > restarts:
            self.get_logger().warning("time went back: beginning anew")
        self._wake()

    def _wake(self) -> None:
        if self._live.due():
            self.worker.put(None)
        else:
            self.worker.touch()

    def _solve_if_due(self, _: None) -> None:
        if self._live.due():
            self._solve(thorough=False)

    def _solve(self, thorough: bool = True) -> str:
        estimate = self._live.solve(thorough)
        self._publish(estimate)
        if thorough:
            self.get_logger().info(summary(estimate))
        else:
            self.get_logger().info(summary(estimate), throttle_duration_sec=1.0)
        counts = f"observations={self._live.observations} activity_bins={self._live.activity_bins}"
        return f"{counts} status={estimate.status}"

    def _publish(self, estimate: OrbitEstimate) -> None:
        spin = estimate.spin
        stamp = estimate.t_last + self._offset if estimate.t_last else self._stamp
        header = Header(stamp=to_stamp(stamp), frame_id=self._camera_frame)
        if spin is not None:
            self._spin_rate.publish(messages.twist_message(estimate, spin, header))
            in_object = Header(stamp=header.stamp, frame_id=self._object_frame)
            self._points.publish(messages.points_message(estimate, spin, in_object))
        self._markers.publish(messages.markers_message(spin, header))
        self._orbit.publish(messages.orbit_message(estimate, header))  # the last, so that it announces the others
        self._spin, self._estimate = spin, estimate
        self._turn(stamp)  # the clock of a recording may have stopped

    def _turn(self, stamp: int | None = None) -> None:
        """Publish the pose of the object at a ROS time in ns, now if None."""
        spin = self._spin
        stamp = self.get_clock().now().nanoseconds if stamp is None else stamp
        if spin is not None:
            header = Header(stamp=to_stamp(stamp), frame_id=self._camera_frame)
            self._tf.publish(messages.transform_message(spin, stamp - self._offset, header, self._object_frame))

    def _diagnose(self) -> None:
        live, apart = self._live, (self.get_clock().now().nanoseconds - self._stamp) / 1e9
        problem = ""
        if live.camera is None:
            problem = "no camera_info yet"
        elif self._stamp and abs(apart) > CLOCK_DIFFERENCE_S and self._spin is not None:
            problem = f"ROS time is {apart:.1f} s past the latest events: no events, or use_sim_time is not set?"
        values = {"observations": live.observations, "activity bins": live.activity_bins, "dropped": live.dropped}
        self._diagnostics.publish(diagnostics(self, problem, values | verdict_values(self._estimate)))


def main() -> None:
    """Run the node."""
    sys.exit(run(BackendNode))


if __name__ == "__main__":
    main()
