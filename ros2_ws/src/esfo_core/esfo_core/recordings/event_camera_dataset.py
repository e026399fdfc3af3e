"""The folders of the Event Camera Dataset (Mueggler et al., IJRR 2017): `events.txt`, `groundtruth.txt`, `calib.txt`.

Numbers stand between spaces, times are in seconds, lengths in metres, polarity is 0 or 1.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from esfo_core.camera import Camera
from esfo_core.errors import CameraError, RecordingError
from esfo_core.events import NS_PER_S, EventArray
from esfo_core.orbit import Matrix

POSE_PERIOD_NS = 5_000_000
"""Poses come at 200 Hz."""

SENSOR = (240, 180)
"""Width and height in pixels of the DAVIS240C; `calib.txt` does not say them."""

_UNIT_TOLERANCE = 1e-3


class Trajectory(Protocol):
    """A camera pose at any time."""

    @property
    def span(self) -> tuple[int, int]:
        """Begin and end, ns."""

    def camera_poses(self, t: NDArray[np.generic]) -> tuple[Matrix, Matrix]:
        """Return positions (N, 3), metres, and quaternions (N, 4), x y z w, of the camera in the world at t (N,) ns."""


@dataclass(frozen=True)
class Poses:
    """Poses of a camera's optical frame in the world.

    t: (N,) int64 ns, increasing. position: (N, 3) metres. orientation: (N, 4) unit quaternions x, y, z, w.
    """

    t: NDArray[np.int64]
    position: Matrix
    orientation: Matrix

    def world_to_camera(self, t: NDArray[np.generic]) -> tuple[NDArray[np.float64], Matrix]:
        """Return R (M, 3, 3) and T (M, 3) at the times t (M,) in ns: the world's point X is at R X + T.

        Positions are interpolated linearly, orientations at constant angular velocity. Raises RecordingError for times
        outside of the poses.
        """
        t = np.atleast_1d(t)
        outside = (t < self.t[0]) | (t > self.t[-1])
        if outside.any():
            raise RecordingError(f"no pose at {t[outside][0]} ns: poses last from {self.t[0]} to {self.t[-1]} ns")
        # Differences first: float64 resolves a time of this century to 256 ns.
        known, asked = (self.t - self.t[0]).astype(np.float64), (t - self.t[0]).astype(np.float64)
        center = np.stack([np.interp(asked, known, column) for column in self.position.T], axis=1)
        turns = Rotation.from_quat(self.orientation)
        R = (Slerp(known, turns)(asked) if len(known) > 1 else turns[np.zeros(len(t), int)]).as_matrix()
        R = R.transpose(0, 2, 1)
        return R, -np.einsum("mij,mj->mi", R, center)


def write_event_camera_dataset(
    folder: Path, chunks: Iterable[EventArray], trajectory: Trajectory, camera: Camera
) -> int:
    """Write events, poses at 200 Hz and calibration into a folder, which is made; return the number of events.

    Times are those of the sensor. Raises CameraError for a lens that `calib.txt` cannot describe.
    """
    calibration = _calib_line(camera)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "calib.txt").write_text(calibration)
    begin, end = trajectory.span
    t = np.append(np.arange(begin, end, POSE_PERIOD_NS), end)
    rows = zip(t.tolist(), np.hstack(trajectory.camera_poses(t)).tolist(), strict=True)
    (folder / "groundtruth.txt").write_text("".join(f"{_seconds(at)} {' '.join(map(repr, row))}\n" for at, row in rows))
    count = 0
    with (folder / "events.txt").open("w") as file:
        for events in chunks:
            count += len(events)
            whole, part = np.divmod(events["t"], NS_PER_S)
            columns = np.stack([whole, part, events["x"], events["y"], events["p"]], axis=1)
            file.write("%d.%09d %d %d %d\n" * len(events) % tuple(columns.ravel().tolist()))
    return count


def read_groundtruth(path: Path) -> Poses:
    """Read `groundtruth.txt`: t px py pz qx qy qz qw.

    Raises RecordingError with the line for one that is no pose, whose quaternion is not of unit length, or whose time
    does not come after the one before.
    """
    times: list[int] = []
    rows: list[list[float]] = []
    for number, fields in _lines(path):
        try:
            times.append(int(np.int64(int((Decimal(fields[0]) * NS_PER_S).to_integral_value()))))
            rows.append([float(field) for field in fields[1:]])
        except (InvalidOperation, ValueError, OverflowError) as error:
            raise RecordingError(f"{path}: line {number} is no pose: {' '.join(fields)[:80]!r}") from error
        if len(fields) != 8 or not np.isfinite(rows[-1]).all():
            raise RecordingError(f"{path}: line {number} is not t px py pz qx qy qz qw: {' '.join(fields)[:80]!r}")
        length = np.linalg.norm(rows[-1][3:])
        if abs(length - 1) > _UNIT_TOLERANCE:
            raise RecordingError(f"{path}: line {number} has a quaternion of length {length:.6g}, not 1")
        if len(times) > 1 and times[-1] <= times[-2]:
            raise RecordingError(f"{path}: line {number} is at {fields[0]} s, not after the line before")
    if not rows:
        raise RecordingError(f"{path}: no pose")
    table = np.array(rows)
    unit = table[:, 3:] / np.linalg.norm(table[:, 3:], axis=1, keepdims=True)
    return Poses(np.array(times, np.int64), table[:, :3], unit)


def read_calib(path: Path, size: tuple[int, int] = SENSOR) -> Camera:
    """Read `calib.txt`: fx fy cx cy k1 k2 p1 p2 k3. size: width and height of the sensor in pixels.

    Raises CameraError for any other content.
    """
    try:
        lines = [fields for _, fields in _lines(path)]
        numbers = [float(field) for fields in lines for field in fields]
    except (RecordingError, ValueError) as error:
        raise CameraError(str(error) if isinstance(error, RecordingError) else f"{path}: {error}") from error
    if len(numbers) != 9:
        raise CameraError(f"{path}: {len(numbers)} numbers, not fx fy cx cy k1 k2 p1 p2 k3")
    fx, fy, cx, cy, *distortion = numbers
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    try:
        return Camera(*size, K, "plumb_bob", np.array(distortion))
    except CameraError as error:
        raise CameraError(f"{path}: {error}") from error


def _calib_line(camera: Camera) -> str:
    if len(camera.D) and camera.distortion_model != "plumb_bob":
        raise CameraError(f"calib.txt takes a plumb_bob lens, not {camera.distortion_model}")
    K, D = camera.K, np.zeros(5)
    D[: len(camera.D)] = camera.D
    return " ".join(repr(float(v)) for v in (K[0, 0], K[1, 1], K[0, 2], K[1, 2], *D)) + "\n"


def _seconds(t: int) -> str:
    return f"{t // NS_PER_S}.{t % NS_PER_S:09d}"


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """Return the numbers and fields of the lines that are neither blank nor start with #."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: not a text") from error
    numbered = ((k, line.split()) for k, line in enumerate(text.splitlines(), 1))
    return [(k, fields) for k, fields in numbered if fields and not fields[0].startswith("#")]
