"""ROS node of the back-end: feature tracks and event activity in, spin rate, orbit, points and pose out.

Times in the messages are sensor times; header stamps are ROS times. The latest activity message gives the difference
of the two, by which the pose in /tf is extrapolated with ROS time between estimates.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from esfo_msgs import msg
from geometry_msgs.msg import TwistWithCovarianceStamped
from sensor_msgs.msg import CameraInfo, PointCloud2
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from esfo_backend.options import PRESETS, BackendOptions
from esfo_backend.ros import messages
from esfo_backend.ros.live_backend import BackendNodeOptions, LiveBackend, verdict_values
from esfo_backend.scale import check_scale
from esfo_backend.warm_up import warm_up
from esfo_core.errors import CameraError
from esfo_core.estimate import OrbitEstimate
from esfo_core.estimate_text import one_line
from esfo_core.orbit import Spin
from esfo_core.recordings.messages import camera_from_info
from esfo_ros.entry_point import run
from esfo_ros.lifecycle_node import ManagedNode
from esfo_ros.services import Service
from esfo_ros.time_stamps import from_stamp, to_stamp
from esfo_ros.topics import CAMERA_INFO, Topic, latched, reliable
from esfo_ros.worker import Worker

TF_PERIOD_S = 1 / 30
CLOCK_DIFFERENCE_S = 5.0

# Much comes while the worker holds the interpreter; nothing of it may be lost.
TRACKS = Topic(
    "feature_tracks", msg.FeatureTracks, reliable(10_000), "observations of tracks: id, sensor time in ns, px"
)
ACTIVITY = Topic("event_activity", msg.EventActivity, reliable(10_000), "event counts by time bin, polarity and cell")
ORBIT = Topic(
    "orbit",
    msg.OrbitEstimate,
    latched(),
    "motion with standard deviations, status, flags and alternatives; camera frame",
)
SPIN_RATE = Topic(
    "spin_rate",
    TwistWithCovarianceStamped,
    latched(),
    "angular velocity in rad/s, camera frame; not published for `failed`",
)
POINTS = Topic(
    "points", PointCloud2, latched(), "x, y, z in units of `scale`, rms_px, rows (observations); object frame"
)
# Latched and reliable: RViz asks for reliable by default, and would not match best effort.
MARKERS = Topic("markers", MarkerArray, latched(), "spin axis, and orbit of the camera about the object; camera frame")
TF = Topic("/tf", TFMessage, reliable(100), "pose of the object frame in the camera frame, 30 Hz of ROS time")


class BackendNode(ManagedNode[BackendOptions, BackendNodeOptions]):
    """Callbacks take messages in; one worker thread solves and publishes."""

    INPUTS = (CAMERA_INFO, TRACKS, ACTIVITY)
    OUTPUTS = (ORBIT, SPIN_RATE, POINTS, MARKERS, TF)
    SERVICES = (
        Service(
            "~/solve",
            "estimates from all data, with every initialisation; returns `observations=.. activity_bins=.. status=..`",
            after_quiet=True,
        ),
        Service("~/reset", "deletes all data except the calibration", after_quiet=False),
        Service(
            "~/save",
            "writes orbit.json, points.ply, tracks.csv, state.npz to a new folder in `save_folder`; returns its path",
            after_quiet=False,
        ),
    )

    def __init__(self) -> None:
        super().__init__("backend", PRESETS, BackendNodeOptions())

    def check(self, options: BackendOptions) -> None:
        """Raise OptionError for more than one known length."""
        check_scale(options.scale)

    def configure(self) -> Worker[None]:
        """Make the back-end, from a saved state if there is one."""
        self._back_end = LiveBackend(self.options)
        if self.live.resume:
            self._back_end.resume(Path(self.live.resume).expanduser())
        self._camera_frame = ""
        self._offset = self._stamp = 0
        self._spin: Spin | None = None
        self._estimate: OrbitEstimate | None = None
        self._complaint = ""
        worker = self.make_worker(self._solve_if_due, capacity=1)
        worker.when_idle(self.live.idle_solve_s, self._solve)
        return worker

    def activate(self) -> None:
        """Subscribe; compile while the first messages arrive, so that the first estimate does not wait."""
        self.subscribe_latched_or_not(CAMERA_INFO, self._on_camera)
        self.subscribe(TRACKS, self._on_tracks)
        self.subscribe(ACTIVITY, self._on_activity)
        if self.worker is not None:
            self.worker.request(_compile, after_quiet=False)
        self._turning = self.tick(TF_PERIOD_S, self._turn, self.get_clock())
        if self._spin is None:
            self._turning.cancel()  # until there is a motion
        self.get_logger().info("ready")

    def clean_up(self) -> None:
        """Drop all data."""
        self._back_end = LiveBackend(self.options)
        self._spin = self._estimate = None

    def reconfigure(self) -> None:
        """Use other options from the next estimate on."""
        self._back_end.configure(self.options)
        if self.worker is not None:
            self.worker.when_idle(self.live.idle_solve_s, self._solve)

    def jobs(self) -> dict[str, Callable[[], str]]:
        """Return the function of each service."""
        return {"~/solve": self._solve, "~/reset": self._reset, "~/save": self._save}

    def _on_camera(self, message: CameraInfo) -> None:
        try:
            camera = camera_from_info(message)
        except CameraError as error:
            self._complaint = f"camera_info: {error}"
            return
        self._complaint = "" if camera else "camera_info is not calibrated (K is zero); waiting for another"
        if camera is not None:
            self._back_end.set_camera(camera)

    def _on_tracks(self, message: msg.FeatureTracks) -> None:
        self._back_end.add_tracks(messages.update_from(message))
        self._wake()

    def _on_activity(self, message: msg.EventActivity) -> None:
        activity = messages.activity_from(message)
        self._camera_frame, self._stamp = message.header.frame_id, from_stamp(message.header.stamp)
        self._offset = self._stamp - activity.end
        restarts = self._back_end.restarts
        self._back_end.add_activity(activity)
        if self._back_end.restarts > restarts:
            self.get_logger().warning("time went back: restarting with an empty stream")
            self._spin = None  # the phase of the earlier stream is not valid in this one
        self._wake()

    def _wake(self) -> None:
        if self.worker is None:
            return
        if self._back_end.due():
            self.worker.put(None)
        else:
            self.worker.touch()

    def _solve_if_due(self, _: None) -> None:
        if self._back_end.due():
            self._solve(thorough=False)

    def _solve(self, thorough: bool = True) -> str:
        estimate = self._back_end.solve(thorough)
        self._publish(estimate)
        if thorough:
            self.get_logger().info(one_line(estimate))
        else:
            self.get_logger().info(one_line(estimate), throttle_duration_sec=1.0)
        counts = f"observations={self._back_end.observations} activity_bins={self._back_end.activity_bins}"
        return f"{counts} status={estimate.status}"

    def _reset(self) -> str:
        self._back_end.reset()
        self._publish(OrbitEstimate.failure("reset"))  # late subscribers must not get the earlier estimate
        return "everything but the camera is forgotten"

    def _save(self) -> str:
        now = datetime.now().astimezone()
        folder = Path(self.live.save_folder).expanduser() / now.strftime("%Y-%m-%dT%H-%M-%S.%f")
        self._back_end.save(folder)
        return str(folder)

    def _publish(self, estimate: OrbitEstimate) -> None:
        spin = estimate.spin
        stamp = estimate.t_last + self._offset if estimate.t_last else self._stamp
        header = Header(stamp=to_stamp(stamp), frame_id=self._camera_frame)
        for topic, message in messages.estimate_messages(estimate, header, self.live.object_frame):
            self.publish(topic, message)
        if spin is not None and self.state == "active" and self._turning.is_canceled():
            self._turning.reset()
        self._spin, self._estimate = spin, estimate
        self._turn(stamp)  # the clock of a recording may have stopped

    def _turn(self, stamp: int | None = None) -> None:
        """Publish the pose of the object at a ROS time in ns, now if None."""
        spin = self._spin
        stamp = self.get_clock().now().nanoseconds if stamp is None else stamp
        if spin is not None:
            header = Header(stamp=to_stamp(stamp), frame_id=self._camera_frame)
            transform = messages.transform_message(spin, stamp - self._offset, header, self.live.object_frame)
            self.publish(TF.name, transform)

    def problems(self) -> dict[str, str]:
        """Return problems with the camera or the clock, by name."""
        apart = (self.get_clock().now().nanoseconds - self._stamp) / 1e9
        found = {}
        if self._complaint:
            found["camera"] = self._complaint
        elif self._back_end.camera is None:
            found["camera"] = "no camera_info yet"
        if self._stamp and abs(apart) > CLOCK_DIFFERENCE_S and self._spin is not None:
            found["time"] = f"ROS time is {apart:.1f} s past the latest events: no events, or use_sim_time is not set?"
        return found

    def values(self) -> dict[str, object]:
        """Return counts and the latest verdict."""
        live = self._back_end
        counts = {"observations": live.observations, "activity bins": live.activity_bins, "dropped": live.dropped}
        return counts | verdict_values(self._estimate)


def _compile() -> str:
    warm_up()
    return ""


def main() -> None:
    """Run the node."""
    sys.exit(run(BackendNode, BackendNode.spin))


if __name__ == "__main__":
    main()
