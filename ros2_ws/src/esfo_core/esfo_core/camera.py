"""Camera intrinsics and lens distortion, as `sensor_msgs/CameraInfo` has them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import yaml
from numpy.typing import NDArray

from esfo_core.calibration_files import read_fields
from esfo_core.errors import CameraError

_COEFFICIENTS = {"plumb_bob": (4, 5), "rational_polynomial": (8,), "equidistant": (4,)}
_NAMES = {
    **dict.fromkeys(("radtan", "radial_tangential", "radialtangential", "radial-tangential", "brown"), "plumb_bob"),
    **dict.fromkeys(("fisheye", "equi", "kannala_brandt", "kb4"), "equidistant"),
    **dict.fromkeys(("rational", "radtan8"), "rational_polynomial"),
}
"""Models of ROS by the names that other tools have for them."""


class HasSize(Protocol):
    """Anything that tells the width and height of a sensor in px: a camera, a recording, a `SensorSize`."""

    @property
    def width(self) -> int:
        """Columns of pixels."""

    @property
    def height(self) -> int:
        """Rows of pixels."""


class SensorSize(NamedTuple):
    """Width and height of a sensor in px, where its camera is not known."""

    width: int
    height: int


@dataclass(frozen=True)
class Camera:
    """A calibrated camera.

    width, height: sensor size in pixels. K: (3, 3) intrinsic matrix in pixels, zero skew.
    distortion_model: `plumb_bob`, `rational_polynomial` or `equidistant`, or the name that another tool has for it;
    D: its coefficients in ROS order (empty: no distortion), of which those at the end may be missing or too many where
    they are zero.
    focal_std: standard deviation of the focal length, relative; 0 for one that is calibrated.

    Raises CameraError for non-finite or impossible values.
    """

    width: int
    height: int
    K: NDArray[np.float64]
    distortion_model: str = "plumb_bob"
    D: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    focal_std: float = 0.0

    def __post_init__(self) -> None:
        if self.width <= 0 or self.height <= 0:
            raise CameraError(f"image size {self.width}x{self.height} is not positive")
        if self.K.shape != (3, 3) or not np.isfinite(self.K).all():
            raise CameraError(f"camera matrix is not 3x3 of finite numbers: {self.K.tolist()}")
        if self.K[0, 0] <= 0 or self.K[1, 1] <= 0:
            raise CameraError(f"focal lengths {self.K[0, 0]}, {self.K[1, 1]} are not positive (uncalibrated?)")
        if self.K[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]].tolist() != [0, 0, 0, 0, 1]:
            raise CameraError(f"camera matrix has skew or a last row other than 0, 0, 1: {self.K.tolist()}")
        if not 0 <= self.focal_std < np.inf:
            raise CameraError(f"standard deviation {self.focal_std} of the focal length is not one")
        self._check_distortion()

    def _check_distortion(self) -> None:
        """Check model and coefficients; bring names and numbers of other tools to those of ROS."""
        name = self.distortion_model.lower()
        object.__setattr__(self, "distortion_model", _NAMES.get(name, self.distortion_model))
        if self.D.ndim != 1 or not np.isfinite(self.D).all():
            raise CameraError(f"distortion coefficients are not a row of finite numbers: {self.D.tolist()}")
        allowed = _COEFFICIENTS.get(self.distortion_model)
        if len(self.D) and allowed is None:
            raise CameraError(f"unknown distortion model {self.distortion_model!r}; known: {sorted(_COEFFICIENTS)}")
        if not self._distorts or allowed is None or len(self.D) in allowed:
            return
        if self.D[allowed[-1] :].any():
            counts = " or ".join(map(str, allowed))
            raise CameraError(f"{self.distortion_model} takes {counts} coefficients, got {len(self.D)}, not all zero")
        filled = np.zeros(allowed[-1])
        filled[: len(self.D)] = self.D[: allowed[-1]]
        object.__setattr__(self, "D", filled)

    @staticmethod
    def pinhole(width: int, height: int, focal_px: float) -> Camera:
        """Return an ideal camera with square pixels and the principal point at the image centre."""
        K = np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1.0]])
        return Camera(width, height, K)

    def with_focal(self, focal_px: float, focal_std: float) -> Camera:
        """Return the camera with another mean focal length in pixels, of standard deviation focal_std (relative)."""
        K = self.K.copy()
        K[[0, 1], [0, 1]] *= focal_px / self.focal_px
        return replace(self, K=K, focal_std=focal_std)

    @property
    def focal_px(self) -> float:
        """Mean focal length in pixels."""
        return float((self.K[0, 0] + self.K[1, 1]) / 2)

    @property
    def _distorts(self) -> bool:
        """False where distorted and ideal points agree. An equidistant lens differs from a pinhole even with zeros."""
        return bool(self.D.any()) or (self.distortion_model == "equidistant" and len(self.D) > 0)

    def _coefficients(self) -> NDArray[np.float64]:
        """Coefficients (8,) in ROS order, zeros for those that the model does not have."""
        d = np.zeros(8)
        d[: len(self.D)] = self.D
        return d

    def _radial(self, r2: NDArray[np.float64]) -> NDArray[np.float64]:
        """Radial part: distorted over ideal radius (N,) at squared ideal radii `r2` (N,)."""
        if self.distortion_model == "equidistant":
            r = np.sqrt(r2)
            theta = np.arctan(r)
            return np.where(r > 1e-12, self._equidistant(theta) / np.maximum(r, 1e-12), 1.0)
        k1, k2, _, _, k3, k4, k5, k6 = self._coefficients()
        return np.asarray((1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6))))

    def _equidistant(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distorted radius (N,) of rays `theta` (N,) radians off the optical axis."""
        k1, k2, k3, k4 = self.D
        q = theta * theta
        return np.asarray(theta * (1 + q * (k1 + q * (k2 + q * (k3 + q * k4)))))

    def distort(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map (N, 2) ideal points of the plane z = 1 to (N, 2) distorted points of that plane."""
        if not self._distorts:
            return xy
        x, y = xy[:, 0], xy[:, 1]
        r2 = x * x + y * y
        radial = self._radial(r2)
        if self.distortion_model == "equidistant":
            return np.asarray(xy * radial[:, None])
        p1, p2 = self.D[2:4]
        return np.stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            ],
            axis=1,
        )

    def project(self, X: NDArray[np.float64]) -> NDArray[np.float64]:
        """Project (N, 3) points of the camera frame (z > 0) to (N, 2) pixels."""
        plane = self.distort(X[:, :2] / X[:, 2:])
        return np.stack([self.K[0, 0] * plane[:, 0] + self.K[0, 2], self.K[1, 1] * plane[:, 1] + self.K[1, 2]], axis=1)

    def unproject(self, uv: NDArray[np.floating]) -> NDArray[np.float64]:
        """Map (N, 2) pixels to (N, 2) ideal points of the plane z = 1.

        Distortion is inverted by iteration. Raises CameraError where that does not converge, where several points
        have the same image or where the ray is 90 degrees or more off the optical axis, because a position made up
        there would be silently wrong.
        """
        focal, centre = np.array([self.K[0, 0], self.K[1, 1]]), np.array([self.K[0, 2], self.K[1, 2]])
        target: NDArray[np.float64] = (np.asarray(uv, np.float64) - centre) / focal
        if not self._distorts:
            return target
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # a diverging iteration is reported below
            xy = self._undistort(target)
            residual = np.abs((self.distort(xy) - target) * focal).max(initial=0.0)
        if not residual < 1e-3:
            raise CameraError(f"lens distortion cannot be inverted over the sensor (residual {residual:.3g} px)")
        # The iteration may end on another branch of the polynomial, beyond the radius where the image folds back.
        r = np.linspace(0.0, np.linalg.norm(xy, axis=1).max(initial=0.0), 1000)[1:]
        if (np.diff(r * self._radial(r * r)) < 0).any():
            raise CameraError(f"lens distortion folds the image within {r[-1]:.3g} focal lengths of its centre")
        return xy

    def _undistort(self, target: NDArray[np.float64]) -> NDArray[np.float64]:
        """Ideal points (N, 2) of distorted ones, as far as the iteration comes."""
        if self.distortion_model == "equidistant":
            radius = np.linalg.norm(target, axis=1)
            theta = radius.copy()
            for _ in range(50):  # Newton's method in the angle, whose slope stays near 1 where that of tan does not
                q = theta * theta
                slope = 1 + sum((2 * i + 3) * k * q ** (i + 1) for i, k in enumerate(self.D))
                step = (self._equidistant(theta) - radius) / slope
                theta -= step
                if np.abs(step).max(initial=0.0) < 1e-14:
                    break
            return np.asarray(target * np.where(radius > 1e-12, np.tan(theta) / radius, 1.0)[:, None])
        xy: NDArray[np.float64] = target.copy()
        for _ in range(100):
            error = self.distort(xy) - target
            xy -= error
            if np.abs(error).max(initial=0.0) < 1e-12:
                break
        return xy

    @cached_property
    def rays(self) -> NDArray[np.float64]:
        """Table (height, width, 2): the plane z = 1 point of every pixel, because event pixels are integers."""
        v, u = np.mgrid[: self.height, : self.width]
        flat = self.unproject(np.stack([u.ravel(), v.ravel()], axis=1))
        return flat.reshape(self.height, self.width, 2)

    @staticmethod
    def read_yaml(path: Path) -> Camera:
        """Read a calibration file of ROS, or of another tool that `calibration_files` knows.

        Raises CameraError with the field that is wrong.
        """
        fields = read_fields(path)
        try:
            return Camera(fields.width, fields.height, fields.K, fields.distortion_model or "plumb_bob", fields.D)
        except CameraError as error:
            raise CameraError(f"{path}: {error}") from error

    def write_yaml(self, path: Path, name: str = "camera") -> None:
        """Write a ROS `camera_calibration` file."""
        P = np.zeros((3, 4))
        P[:, :3] = self.K

        def matrix(m: NDArray[np.float64]) -> dict[str, object]:
            return {"rows": m.shape[0], "cols": m.shape[1], "data": [float(v) for v in m.ravel()]}

        content = {
            "image_width": self.width,
            "image_height": self.height,
            "camera_name": name,
            "camera_matrix": matrix(self.K),
            "distortion_model": self.distortion_model,
            "distortion_coefficients": matrix(self.D.reshape(1, -1)),
            "rectification_matrix": matrix(np.eye(3)),
            "projection_matrix": matrix(P),
        }
        path.write_text(yaml.safe_dump(content, sort_keys=False, default_flow_style=None), encoding="utf-8")
