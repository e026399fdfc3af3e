"""Camera calibrations as the tools of the field write them, brought to the fields of a ROS camera_calibration file.

Known are ROS and OpenCV (YAML, JSON, XML), Kalibr, Prophesee, DV, basalt and COLMAP. What else stands in such a file is
not read.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml
from numpy.typing import NDArray

from esfo_core.errors import CameraError

_OPENCV_TAG = re.compile(r"!!opencv-\S+")
_COLMAP_LINE = re.compile(r"^\d+\s+([A-Z_]+)\s+(\d+)\s+(\d+)\s+(.*)$", re.MULTILINE)
_MATRIX = ("camera_matrix", "K", "k", "intrinsic_matrix", "CameraMatrix")
_COEFFICIENTS = ("distortion_coefficients", "D", "d", "distortion_coeffs", "dist_coeffs", "DistCoeffs")
_WIDTH, _HEIGHT = ("image_width", "width", "imageWidth"), ("image_height", "height", "imageHeight")

# COLMAP's models: what the parameters are, and the distortion that they make.
_COLMAP = {
    "SIMPLE_PINHOLE": ("f cx cy", "plumb_bob"),
    "PINHOLE": ("fx fy cx cy", "plumb_bob"),
    "SIMPLE_RADIAL": ("f cx cy k1", "plumb_bob"),
    "RADIAL": ("f cx cy k1 k2", "plumb_bob"),
    "OPENCV": ("fx fy cx cy k1 k2 p1 p2", "plumb_bob"),
    "OPENCV_FISHEYE": ("fx fy cx cy k1 k2 k3 k4", "equidistant"),
    "FULL_OPENCV": ("fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6", "rational_polynomial"),
}
_BASALT = {
    "pinhole": ("", "plumb_bob"),
    "kb4": ("k1 k2 k3 k4", "equidistant"),
    "pinhole-radtan8": ("k1 k2 p1 p2 k3 k4 k5 k6", "rational_polynomial"),
}


@dataclass(frozen=True)
class CalibrationFields:
    """What a file says of a camera: image size and K (3, 3) in pixels, distortion model as named, coefficients."""

    width: int
    height: int
    K: NDArray[np.float64]
    distortion_model: str
    D: NDArray[np.float64]


def read_fields(path: Path) -> CalibrationFields:
    """Read a calibration file. Raises CameraError with what is missing or wrong in it."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise CameraError(f"{path}: {error.strerror}") from error
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")  # comments and names of cameras
    try:
        return _fields(text)
    except CameraError as error:
        raise CameraError(f"{path}: {error}") from error


def _fields(text: str) -> CalibrationFields:
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if lines and _COLMAP_LINE.match(lines[0]):
        return _colmap("\n".join(lines))
    content = _xml(text) if text.lstrip().startswith("<") else _yaml(text)
    if not isinstance(content, Mapping):
        raise CameraError("not a calibration: it holds no named fields")
    for key, read in _READERS.items():
        if key in content:
            return read(content)
    return _usual(content)


def _yaml(text: str) -> Any:
    """Read YAML or JSON; OpenCV begins its YAML with a line, and marks matrices, as no other does."""
    if text.startswith("%YAML"):
        text = text.partition("\n")[2]
    try:
        return yaml.safe_load(_OPENCV_TAG.sub("", text))
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise CameraError(f"not a YAML, JSON or XML file ({str(error).splitlines()[0]})") from error


def _xml(text: str) -> Any:
    try:
        root = ElementTree.fromstring(re.sub(r"^\s*<\?xml[^>]*\?>", "", text))
    except ElementTree.ParseError as error:
        raise CameraError(f"not an XML file ({error})") from error
    return _xml_value(root)


def _xml_value(element: ElementTree.Element) -> Any:
    if len(element):
        return {child.tag: _xml_value(child) for child in element}
    words = (element.text or "").split()
    return words if element.tag == "data" else " ".join(words)


def _usual(content: Mapping[str, Any]) -> CalibrationFields:
    """The fields of ROS, OpenCV and Prophesee; they may stand in a part of the file that has the name of the camera."""
    name = next((name for name in _MATRIX if name in content), None)
    if name is None:
        parts = {key: part for key, part in content.items() if isinstance(part, Mapping) and _has_matrix(part)}
        if len(parts) > 1:
            raise CameraError(f"several cameras in one file: {', '.join(map(str, parts))}; leave one in it")
        if not parts:
            found = ", ".join(map(str, content)) or "nothing"
            raise CameraError(f"no camera matrix (camera_matrix) in it, only {found[:80]}")
        return _usual({**content, **next(iter(parts.values()))})
    coefficients = _first(content, _COEFFICIENTS)
    D = np.zeros(0) if coefficients is None else _numbers(coefficients, "distortion_coefficients")
    model = str(content.get("distortion_model") or "")
    if not model:
        fisheye = str(content.get("fisheye_model", "0")).lower() in ("1", "true")
        model = "equidistant" if fisheye else ("rational_polynomial" if D[5:].any() else "plumb_bob")
    width, height = _size(content)
    matrix = _numbers(content[name], name)
    if len(matrix) != 9:
        raise CameraError(f"{name} has {len(matrix)} numbers, not 9")
    return CalibrationFields(width, height, matrix.reshape(3, 3), model, D)


def _has_matrix(part: Mapping[str, Any]) -> bool:
    return any(name in part for name in _MATRIX)


def _first(content: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    return next((content[name] for name in names if content.get(name) is not None), None)


def _size(content: Mapping[str, Any]) -> tuple[int, int]:
    size = _first(content, ("image_size", "resolution", "imageSize"))
    if isinstance(size, Mapping):
        content = {**content, **size}
    elif isinstance(size, list | tuple) and len(size) == 2:
        content = {**content, "image_width": size[0], "image_height": size[1]}
    elif isinstance(size, str) and len(size.split()) == 2:
        content = {**content, **dict(zip(("image_width", "image_height"), size.split(), strict=True))}
    return _whole(content, _WIDTH), _whole(content, _HEIGHT)


def _whole(content: Mapping[str, Any], names: tuple[str, ...]) -> int:
    value = _first(content, names)
    if value is None:
        raise CameraError(f"no {names[0]} in it; add the size of the sensor in pixels")
    number = _numbers(value, names[0])
    if len(number) != 1 or not number[0].is_integer():
        raise CameraError(f"{names[0]} is {value!r}, not a whole number")
    return int(number[0])


def _numbers(value: Any, name: str) -> NDArray[np.float64]:
    """All numbers of a matrix in whatever form, in a row: with its data in a field, as lists of lists, as text."""
    if isinstance(value, Mapping):
        if "data" not in value:
            raise CameraError(f"{name} has no data")
        value = value["data"]
    if isinstance(value, str):
        value = value.split()
    try:
        return np.array(value, np.float64).ravel()
    except (TypeError, ValueError, OverflowError):
        raise CameraError(f"{name} is {str(value)[:60]!r}, not numbers") from None


def _kalibr(content: Mapping[str, Any]) -> CalibrationFields:
    cameras = [key for key, part in content.items() if isinstance(part, Mapping) and "intrinsics" in part]
    if len(cameras) != 1:
        raise CameraError(f"Kalibr file of {len(cameras)} cameras: {', '.join(cameras)}; leave the one of the events")
    camera = content[cameras[0]]
    model = str(camera.get("camera_model", "pinhole"))
    if model != "pinhole":
        raise CameraError(f"Kalibr camera_model {model!r}: only pinhole is known")
    fx, fy, cx, cy = _some(camera.get("intrinsics"), "intrinsics", 4)
    distortion = str(camera.get("distortion_model", "none"))
    D = _numbers(camera.get("distortion_coeffs") or [], "distortion_coeffs")
    return _made(_size(camera), (fx, fy, cx, cy), distortion, D)


def _dv(content: Mapping[str, Any]) -> CalibrationFields:
    cameras = content["cameras"]
    if not isinstance(cameras, list) or len(cameras) != 1 or not isinstance(cameras[0], Mapping):
        raise CameraError("DV file without one camera; leave the one of the events in its list cameras")
    camera = cameras[0]
    fx, fy = _some(camera.get("focalLength"), "focalLength", 2)
    cx, cy = _some(camera.get("principalPoint"), "principalPoint", 2)
    D = _numbers(camera.get("distortion") or [], "distortion")
    return _made(_size(camera), (fx, fy, cx, cy), str(camera.get("distortionModel", "")), D)


def _basalt(content: Mapping[str, Any]) -> CalibrationFields:
    try:
        (camera,), (size,) = content["value0"]["intrinsics"], content["value0"]["resolution"]
        kind, values = str(camera["camera_type"]), camera["intrinsics"]
    except (KeyError, TypeError, ValueError):
        raise CameraError("basalt file without one camera; leave the one of the events in it") from None
    if kind not in _BASALT:
        raise CameraError(f"basalt camera_type {kind!r}: known are {', '.join(_BASALT)}")
    names, model = _BASALT[kind]
    wanted = ["fx", "fy", "cx", "cy", *names.split()]
    numbers = _some([values.get(name) for name in wanted], f"intrinsics {' '.join(wanted)}", len(wanted))
    return _made(_size({"resolution": size}), numbers[:4], model, np.array(numbers[4:]))


def _colmap(text: str) -> CalibrationFields:
    cameras = _COLMAP_LINE.findall(text)
    if len(cameras) != 1:
        raise CameraError(f"COLMAP file of {len(cameras)} cameras; leave the one of the events")
    kind, width, height, rest = cameras[0]
    if kind not in _COLMAP:
        raise CameraError(f"COLMAP model {kind}: known are {', '.join(_COLMAP)}")
    names, model = _COLMAP[kind]
    values = dict(zip(names.split(), _some(rest, "parameters", len(names.split())), strict=True))
    focal = values.get("f", 0.0)
    # COLMAP's pixel (0, 0) has its centre at (0.5, 0.5).
    pinhole = (values.get("fx", focal), values.get("fy", focal), values["cx"] - 0.5, values["cy"] - 0.5)
    D = np.array([value for name, value in values.items() if name[0] in "kp"])
    return _made((int(width), int(height)), pinhole, model, D)


def _some(value: Any, name: str, count: int) -> tuple[float, ...]:
    numbers = _numbers([] if value is None else value, name)
    if len(numbers) != count:
        raise CameraError(f"{name} has {len(numbers)} numbers, not {count}")
    return tuple(numbers.tolist())


def _made(size: tuple[int, int], pinhole: tuple[float, ...], model: str, D: NDArray[np.float64]) -> CalibrationFields:
    fx, fy, cx, cy = pinhole
    model = "plumb_bob" if model.lower() == "none" and not D.any() else model
    return CalibrationFields(*size, np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), model, D)


_READERS: dict[str, Callable[[Mapping[str, Any]], CalibrationFields]] = {
    "cam0": _kalibr,
    "cameras": _dv,
    "value0": _basalt,
}
"""Readers by a field that only their files have."""
