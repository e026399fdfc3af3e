"""From free camera poses to an orbit (paper, section 5.1): plane, circle and phase slope."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esfo_backend.errors import BackendError
from esfo_backend.orbit.parametrization import Motion, motion_from_axis
from esfo_core.orbit import Matrix, Vector


@dataclass(frozen=True)
class Circle:
    """Circle in space: center (3,), unit normal (3,), radius, and the RMS distance of the points from it."""

    center: Vector
    normal: Vector
    radius: float
    rms: float


@dataclass(frozen=True)
class CameraOrbit:
    """Motion estimated from free camera poses.

    motion: the four parameters. turns: revolutions over the views, from the phase. circle_residual: RMS distance of the
    camera centres from the circle, in radii. rate_std_hz: of the phase slope.
    """

    motion: Motion
    turns: float
    circle_residual: float
    rate_std_hz: float


def fit_circle(points: Matrix) -> Circle:
    """Fit a circle to (N, 3) points: plane by SVD, then the implicit circle equation by least squares.

    The paper fits the plane as z = ax + by, which fails for a vertical plane; the SVD does not.
    Raises BackendError for fewer than three distinct points.
    """
    if len(points) < 3:
        raise BackendError(f"{len(points)} camera centres do not determine a circle")
    mean = points.mean(axis=0)
    _, spread, basis = np.linalg.svd(points - mean)
    if spread[1] < 1e-12 * max(spread[0], 1e-300):
        raise BackendError("the camera centres lie on a line, which is no orbit")
    plane = (points - mean) @ basis[:2].T
    A = np.column_stack([plane, np.ones(len(plane))])
    theta = np.linalg.lstsq(A, (plane**2).sum(axis=1), rcond=None)[0]
    middle = theta[:2] / 2
    radius = float(np.sqrt(theta[2] + middle @ middle))
    radial = np.linalg.norm(plane - middle, axis=1) - radius
    off_plane = (points - mean) @ basis[2]
    rms = float(np.sqrt(np.mean(radial**2 + off_plane**2)))
    return Circle(mean + middle @ basis[:2], basis[2], radius, rms)


def orbit_of_cameras(R: Matrix, t: Matrix, seconds: Vector) -> CameraOrbit:
    """Estimate the motion from world-to-camera poses R (N, 3, 3), t (N, 3) at times (N,) in s.

    The rate is the slope of the phase on the circle; the normal has the sign for which the phase increases.
    Raises BackendError when the poses are no orbit.
    """
    order = np.argsort(seconds)
    R, t, seconds = R[order], t[order], seconds[order]
    centers = -np.einsum("nji,nj->ni", R, t)
    circle = fit_circle(centers)
    normal = circle.normal
    e1 = centers[0] - circle.center
    e1 -= (e1 @ normal) * normal
    e1 /= np.linalg.norm(e1)
    offset = centers - circle.center
    phase = np.unwrap(np.arctan2(offset @ np.cross(normal, e1), offset @ e1))
    slope = robust_slope(seconds, phase)
    if slope < 0:
        normal, phase, slope = -normal, -phase, -slope
    residual = phase - np.median(phase - slope * seconds) - slope * seconds
    spread = np.sqrt(np.mean(residual**2) / max(len(seconds) - 2, 1) / max(np.var(seconds), 1e-300))
    # In an orbit the normal is constant in the camera frame.
    in_camera = (R @ normal).mean(axis=0)
    towards = (np.einsum("nij,j->ni", R, circle.center) + t).mean(axis=0)
    motion = motion_from_axis(-in_camera / np.linalg.norm(in_camera), towards, slope / (2 * np.pi))
    return CameraOrbit(
        motion, float((phase[-1] - phase[0]) / (2 * np.pi)), circle.rms / circle.radius, float(spread / (2 * np.pi))
    )


def robust_slope(x: Vector, y: Vector) -> float:
    """Median slope between points N/2 apart (Theil-Sen with N/2 pairs), robust to single bad views."""
    half = len(x) // 2
    if half == 0:
        raise BackendError("one camera has no phase slope")
    return float(np.median((y[half:] - y[: len(x) - half]) / (x[half:] - x[: len(x) - half])))
