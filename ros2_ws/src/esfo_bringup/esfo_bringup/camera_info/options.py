"""Options of the node."""

from __future__ import annotations

from dataclasses import dataclass

from esfo_core.options import option


@dataclass(frozen=True)
class CameraInfoOptions:
    """Which calibration is published, and for which frame."""

    camera: str = option("", "path of a camera_calibration YAML")
    frame_id: str = option("camera", "name of the camera's optical frame")
