"""The launch file with the real nodes, where `ros2 launch` exists."""

import shutil
from pathlib import Path

import pytest

pytest.importorskip("launch_ros.actions", reason="no launch_ros here: ROS comes as wheels", exc_type=ImportError)

import spinning_squares
from esfo_msgs.msg import OrbitEstimate
from listener import LATCHED
from sensor_msgs.msg import PointCloud2

LAUNCH_FILE = Path(__file__).parents[2] / "ros2_ws/src/esfo_bringup/launch/esfo.launch.py"


def test_one_line_replays_a_recording_below_a_namespace(recording, listener, start):
    ros2 = shutil.which("ros2")
    if ros2 is None:
        pytest.skip("no ros2 command here")
    orbits = listener.listen(OrbitEstimate, "/left/orbit", LATCHED)
    points = listener.listen(PointCloud2, "/left/points", LATCHED)
    start(ros2, "launch", LAUNCH_FILE, f"bag:={recording}", "rate:=0", "namespace:=left")
    listener.until(lambda: points and orbits and orbits[-1].status == OrbitEstimate.STATUS_OK)
    assert orbits[-1].rate_hz == pytest.approx(spinning_squares.SPIN.rate_hz, rel=0.005)
    assert orbits[-1].header.frame_id == "left/camera"
    assert points[-1].header.frame_id == "left/object"
