"""Which of the `CameraInfo` topics of a bag is that of the events."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import islice
from typing import Any

from esfo_core.camera import Camera
from esfo_core.errors import CameraError
from esfo_core.recordings.messages import camera_from_info

_LOOKED_AT = 1000
"""Messages of a topic in which a calibrated one is looked for; a driver gets its calibration soon or never."""


def camera_of(infos: Mapping[str, Iterable[Any]], beside: str, size: tuple[int, int]) -> Camera | None:
    """Return the camera of a sensor of `size` (width, height) in pixels, None where no topic has one.

    infos: messages by topic. The topic `beside` the events counts first, then the only other one that fits.

    Raises CameraError for impossible values or another size of the topic beside the events where no other fits, and
    where several others fit and differ.
    """
    fitting: dict[str, Camera] = {}
    faults: dict[str, str] = {}
    for topic, messages in infos.items():
        try:
            camera = _first_calibrated(messages, size)
        except CameraError as error:
            faults[topic] = f"{topic!r}: {error}"
            continue
        if camera is not None and (camera.width, camera.height) == size:
            fitting[topic] = camera
        elif camera is not None and topic == beside:  # elsewhere it is another camera's
            faults[topic] = f"{topic!r} is of {camera.width}x{camera.height} pixels, the events of {size[0]}x{size[1]}"
    if beside in fitting:
        return fitting[beside]
    if not fitting:
        if faults:
            raise CameraError(next(iter(faults.values())))
        return None
    first, *others = fitting.values()
    if any((c.K != first.K).any() or c.D.tolist() != first.D.tolist() for c in others):
        raise CameraError(f"several camera_info topics fit the events and differ: {', '.join(fitting)}")
    return first


def _first_calibrated(messages: Iterable[Any], size: tuple[int, int]) -> Camera | None:
    for info in islice(messages, _LOOKED_AT):
        if (int(info.width), int(info.height)) == (0, 0):  # drivers that know the lens but not the sensor
            info.width, info.height = size
        camera = camera_from_info(info)
        if camera is not None:
            return camera
    return None
