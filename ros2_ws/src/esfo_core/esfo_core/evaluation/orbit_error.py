"""Errors of an estimate against the truth: of the rate, the axis and the image of the axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from esfo_core.camera import Camera
from esfo_core.errors import EsfoError
from esfo_core.orbit import Spin, angle_between

_SCREW_LINE_PART = 0.25  # of the distance to the object, to either side of its centre: about the size of an object


class EvaluationError(EsfoError):
    """An estimate or a truth lacks a field that the comparison needs."""


@dataclass(frozen=True)
class Evaluation:
    """Errors of an estimate; each is >= 0.

    rate_error: relative to the true rate. axis_error_deg: angle between the axes, 180 for the opposite spin.
    screw_line_error_px: mean distance of the true image of the axis from the estimated one (paper, section 6.3),
    None without a camera or where one of the two is no line in the image.
    """

    rate_error: float
    axis_error_deg: float
    screw_line_error_px: float | None = None


def compare(orbit_json: Mapping[str, object], truth: Mapping[str, object], camera: Camera | None = None) -> Evaluation:
    """Compare the content of `orbit.json` with the truth.

    Both have `spin_rate_hz`, `axis` (3,) and `center` (3,) in the camera's optical frame. An axis is right-handed with
    the spin, so a negative rate about the opposite axis is the same motion. Lengths may differ in scale: only
    directions and images are compared. Raises EvaluationError for a failed estimate and for a missing or
    impossible field.
    """
    if "status" not in orbit_json:
        raise EvaluationError("estimate has no status")
    if orbit_json["status"] == "failed":
        raise EvaluationError(f"the estimate has failed: {orbit_json.get('reason') or 'no reason given'}")
    estimated, true = spin_of(orbit_json, "estimate"), spin_of(truth, "truth")
    return Evaluation(
        abs(estimated.rate_hz - true.rate_hz) / true.rate_hz,
        angle_between(estimated.axis, true.axis),
        None if camera is None else _screw_line_error(estimated, true, camera),
    )


def _screw_line_error(estimated: Spin, true: Spin, camera: Camera) -> float | None:
    pixels = true.screw_line(camera, _SCREW_LINE_PART * float(np.linalg.norm(true.center)))
    pixels = pixels[((pixels >= 0) & (pixels <= [camera.width - 1, camera.height - 1])).all(axis=1)]
    moment = np.cross(estimated.center, estimated.axis)  # normal of the plane through the camera and the axis
    slope = float(np.linalg.norm(moment[:2]))
    if not len(pixels) or not (slope > 1e-9 * np.linalg.norm(estimated.center)) or _is_point(true):
        return None
    rays = np.concatenate([camera.unproject(pixels), np.ones((len(pixels), 1))], axis=1)
    return float(np.abs(rays @ moment).mean() / slope * camera.focal_px)


def _is_point(spin: Spin) -> bool:
    """True where the axis passes through the camera, so that its image is a point."""
    return bool(np.linalg.norm(np.cross(spin.center, spin.axis)) <= 1e-9 * np.linalg.norm(spin.center))


def spin_of(values: Mapping[str, object], source: str) -> Spin:
    """Return the spin of `orbit.json` or of a truth; a negative rate about the opposite axis is the same motion.

    source: name of the content in messages. Raises EvaluationError for a missing or impossible field.
    """
    rate = float(_numbers(values, "spin_rate_hz", source, 1)[0])
    axis, center = _numbers(values, "axis", source, 3), _numbers(values, "center", source, 3)
    length = np.linalg.norm(axis)
    if rate == 0 or length == 0:
        raise EvaluationError(f"{source} does not spin: spin_rate_hz {rate}, axis {axis.tolist()}")
    return Spin(axis / length * np.sign(rate), abs(rate), center, 0)


def _numbers(values: Mapping[str, object], name: str, source: str, count: int) -> NDArray[np.float64]:
    if values.get(name) is None:
        raise EvaluationError(f"{source} has no {name}")
    try:
        numbers = np.atleast_1d(np.asarray(values[name], np.float64))
    except (TypeError, ValueError) as error:
        raise EvaluationError(f"{source}: {name} is {values[name]!r}, not {count} numbers") from error
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise EvaluationError(f"{source}: {name} is {values[name]!r}, not {count} finite numbers")
    return numbers
