"""ROS node that publishes the calibration in a file, for cameras whose driver does not."""

from __future__ import annotations

import sys
from pathlib import Path

from rclpy.node import Node

from esfo_bringup.camera_info.options import CameraInfoOptions
from esfo_bringup.replay.messages import camera_info_message
from esfo_core.camera import Camera
from esfo_core.errors import OptionError
from esfo_ros.entry_point import run
from esfo_ros.parameters import declare_fields
from esfo_ros.topics import CAMERA_INFO


class CameraInfoNode(Node):  # type: ignore[misc]
    """Publishes the calibration once, on a latched topic."""

    OUTPUTS = (CAMERA_INFO,)

    def __init__(self) -> None:
        super().__init__("camera_info")
        options = declare_fields(self, CameraInfoOptions())
        if not options.camera:
            raise OptionError("parameter camera is not set")
        camera = Camera.read_yaml(Path(options.camera))
        self._publisher = self.create_publisher(CAMERA_INFO.kind, CAMERA_INFO.name, CAMERA_INFO.qos)
        self._publisher.publish(camera_info_message(camera, options.frame_id))
        self.get_logger().info(f"{options.camera}: {camera.width}x{camera.height} px, frame {options.frame_id}")


def main() -> None:
    """Run the node."""
    sys.exit(run(CameraInfoNode))


if __name__ == "__main__":
    main()
