"""A recording and its camera."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from esfo_core.camera import Camera
from esfo_core.errors import CameraError
from esfo_core.estimate import OrbitEstimate
from esfo_core.recordings import ReadingOptions, Recording, open_recording

ASSUMED_FOCAL, ASSUMED_FOCAL_STD = 1.0, 0.4
"""Focal length over the width of the image where nothing tells it, a lens of 53 degrees, and its relative standard
deviation: two of them reach from 0.45 to 2.2, lenses of 96 to 26 degrees."""


@dataclass(frozen=True)
class Source:
    """A recording and its camera. assumed: the intrinsics are a guess, because no calibration is given."""

    recording: Recording
    camera: Camera
    assumed: bool


def open_source(
    path: Path, camera: Camera | Path | None, topic: str | None = None, options: ReadingOptions | None = None
) -> Source:
    """Open a recording with its camera: the one given or its file, else that of the recording, else a marked guess.

    topic, options: what the recording does not tell; a camera given tells the sensor size. Raises RecordingError, and
    CameraError when the camera is of another size than the sensor.
    """
    reading = options or ReadingOptions()
    given = Camera.read_yaml(camera) if isinstance(camera, Path) else camera
    if given is not None and reading.size is None:
        reading = replace(reading, width=given.width, height=given.height)
    recording = open_recording(path, topic, reading)
    used = given or recording.camera
    if used is None:
        lens = Camera.pinhole(recording.width, recording.height, ASSUMED_FOCAL * recording.width)
        return Source(recording, replace(lens, focal_std=ASSUMED_FOCAL_STD), True)
    check_size(used, recording, "the camera")
    return Source(recording, used, False)


def choose_camera(recording: Recording, override: str) -> Camera | None:
    """Return the camera of the YAML file `override`, or that of the recording when it is empty.

    Raises CameraError when the file cannot be read or is for another sensor size.
    """
    if not override:
        return recording.camera
    camera = Camera.read_yaml(Path(override))
    check_size(camera, recording, override)
    return camera


def check_size(camera: Camera, recording: Recording, name: str) -> None:
    """Raise CameraError, with `name` for the camera, unless it has the size of the recording's sensor."""
    if (camera.width, camera.height) != (recording.width, recording.height):
        raise CameraError(
            f"{name} is of {camera.width}x{camera.height} px, the recording of {recording.width}x{recording.height}"
        )


def with_source(estimate: OrbitEstimate, source: Source) -> OrbitEstimate:
    """Return the estimate, with the flag `intrinsics_assumed` when the camera is a guess."""
    if not source.assumed:
        return estimate
    return replace(estimate, flags=(*estimate.flags, "intrinsics_assumed"))
