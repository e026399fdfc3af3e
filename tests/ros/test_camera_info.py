"""The node that publishes a calibration: late subscribers get it, and what is wrong is one line."""

import subprocess

import pytest

pytest.importorskip("esfo_msgs.msg", reason="the messages are not built: make setup")

import spinning_squares
from graph import executable
from listener import LATCHED, PATIENCE_S
from sensor_msgs.msg import CameraInfo

from esfo_core.recordings.messages import camera_from_info

NODE = ("esfo_bringup", "camera_info_node")


def test_a_late_subscriber_gets_the_calibration_of_the_file(tmp_path, listener, start):
    path = tmp_path / "camera.yaml"
    spinning_squares.CAMERA.write_yaml(path)
    start(executable(*NODE), "--ros-args", "-p", f"camera:={path}", "-p", "frame_id:=left/camera")
    listener.until(lambda: listener.node.count_publishers("camera_info"))
    listener.spin(1.0)
    got = listener.listen(CameraInfo, "camera_info", LATCHED)
    listener.until(lambda: got)
    assert got[0].header.frame_id == "left/camera"
    camera, expected = camera_from_info(got[0]), spinning_squares.CAMERA
    assert (camera.width, camera.height, camera.distortion_model) == (240, 180, expected.distortion_model)
    assert camera.K.tobytes() == expected.K.tobytes()
    assert camera.D.tobytes() == expected.D.tobytes()


@pytest.mark.parametrize(
    ("camera", "says"), [("", "parameter camera is not set"), ("/none.yaml", "/none.yaml"), ("broken", "broken.yaml")]
)
def test_a_calibration_that_cannot_be_read_is_one_line(tmp_path, ros_domain, camera, says):
    (tmp_path / "broken.yaml").write_text("image_width: 3\n")
    value = tmp_path / "broken.yaml" if camera == "broken" else camera
    command = [executable(*NODE), "--ros-args", *(["-p", f"camera:={value}"] if camera else [])]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert says in line
