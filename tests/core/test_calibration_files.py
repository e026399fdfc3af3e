"""One camera in the files of many tools, and what is wrong with files that hold none."""

from __future__ import annotations

import json

import numpy as np
import pytest

from esfo_core.camera import Camera
from esfo_core.errors import CameraError

K, D = [[310.5, 0.0, 121.25], [0.0, 305.0, 88.5], [0.0, 0.0, 1.0]], [-0.11, 0.02, 0.001, -0.002]
FLAT = [v for row in K for v in row]
SIZE = "image_width: 240\nimage_height: 180\n"
OPENCV = "!!opencv-matrix\n   rows: {}\n   cols: {}\n   dt: d\n   data: {}\n"
PINHOLE = [310.5, 305.0, 121.25, 88.5]


def opencv_yaml(start, D, more=""):
    matrix, coefficients = OPENCV.format(3, 3, FLAT), OPENCV.format(len(D), 1, D)
    return f"{start}\n{SIZE}{more}camera_matrix: {matrix}distortion_coefficients: {coefficients}"


def xml(inner_size, wrap=""):
    words = " ".join(map(str, FLAT)), " ".join(map(str, D))
    size = "<image_width>240</image_width><image_height>180</image_height>" if inner_size else ""
    body = (
        f'{size}<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt><data>{words[0]}</data>'
        f'</camera_matrix><distortion_coefficients type_id="opencv-matrix"><data>{words[1]}</data>'
        "</distortion_coefficients>"
    )
    body = f"<{wrap}>{body}</{wrap}>" if wrap else body
    return f'<?xml version="1.0"?>\n<opencv_storage>\n{body}\n</opencv_storage>\n'


def kalibr(**changes):
    camera = {"camera_model": "pinhole", "intrinsics": PINHOLE, "distortion_model": "radtan", "distortion_coeffs": D}
    return json.dumps({"cam0": {**camera, "resolution": [240, 180], "rostopic": "/dvs", **changes}})


def dv(**changes):
    camera = {"name": "DVX", "resolution": [240, 180], "focalLength": [310.5, 305.0], "principalPoint": [121.25, 88.5]}
    return json.dumps({"cameras": [{**camera, "distortion": D, "distortionModel": "RADIAL_TANGENTIAL", **changes}]})


def basalt(kind, **more):
    values = dict(zip(("fx", "fy", "cx", "cy"), PINHOLE, strict=True)) | more
    return json.dumps(
        {"value0": {"intrinsics": [{"camera_type": kind, "intrinsics": values}], "resolution": [[240, 180]]}}
    )


def ros(model, D, name="camera_matrix"):
    matrix = f"{SIZE}{name}: {{rows: 3, cols: 3, data: {FLAT}}}\n"
    return f"{matrix}distortion_model: {model}\ndistortion_coefficients: {{data: {D}}}\n"


ZEROS = [0.0] * 10


@pytest.mark.parametrize(
    ("text", "model", "coefficients"),
    [
        (opencv_yaml("%YAML:1.0\n---", D), "plumb_bob", D),
        (opencv_yaml("%YAML 1.0\n---", [*D, 0.3]), "plumb_bob", [*D, 0.3]),
        (opencv_yaml("%YAML:1.0", [*D, *ZEROS]), "plumb_bob", D),
        (
            opencv_yaml("%YAML:1.0", [*D, 0.1, 0.2, 0.3, 0.4, *ZEROS[:6]]),
            "rational_polynomial",
            [*D, 0.1, 0.2, 0.3, 0.4],
        ),
        (opencv_yaml("%YAML:1.0", D, "fisheye_model: 1\n"), "equidistant", D),
        (xml(True), "plumb_bob", D),
        (xml(True, "DAVIS346_0001"), "plumb_bob", D),
        (kalibr(), "plumb_bob", D),
        (kalibr(distortion_model="equi"), "equidistant", D),
        (kalibr(distortion_model="none", distortion_coeffs=[]), "plumb_bob", []),
        (dv(), "plumb_bob", D),
        (dv(distortion=[], distortionModel="NONE"), "plumb_bob", []),
        (basalt("pinhole"), "plumb_bob", []),
        (basalt("kb4", k1=-0.11, k2=0.02, k3=0.001, k4=-0.002), "equidistant", D),
        ("# made\n1 OPENCV 240 180 310.5 305 121.75 89 -0.11 0.02 0.001 -0.002\n", "plumb_bob", D),
        ("1 PINHOLE 240 180 310.5 305 121.75 89\n", "plumb_bob", []),
        (json.dumps({"camera_matrix": {"data": FLAT}, "image_size": {"width": 240, "height": 180}}), "plumb_bob", []),
        (f"{SIZE}K: {K}\nD: {D}\n", "plumb_bob", D),
        (f"{SIZE}camera_matrix: {FLAT}\ndistortion_coefficients: {D}\n", "plumb_bob", D),
        (f"# für Büro\n{SIZE}K: {K}\nD: {D}\n", "plumb_bob", D),
        (ros("radtan", D), "plumb_bob", D),
        (ros("fisheye", D), "equidistant", D),
        (ros("plumb_bob", [*D, *ZEROS]), "plumb_bob", D),
        (ros("plumb_bob", D[:2]), "plumb_bob", D[:2]),
        (ros("rational_polynomial", [*D, 0.3]), "rational_polynomial", [*D, 0.3]),
        (ros("rational_polynomial", [*D, *ZEROS]), "rational_polynomial", D),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_one_camera_in_many_files(tmp_path, text, model, coefficients, encoding):
    path = tmp_path / "calibration"
    path.write_bytes(text.replace("\n", "\r\n").encode(encoding))
    camera = Camera.read_yaml(path)
    assert (camera.width, camera.height, camera.distortion_model) == (240, 180, model)
    assert np.allclose(camera.K, K, atol=1e-12)
    assert camera.D[: len(coefficients)].tolist() == coefficients
    assert not camera.D[len(coefficients) :].any()
    camera.write_yaml(tmp_path / "standard.yaml")
    again = Camera.read_yaml(tmp_path / "standard.yaml")
    assert (again.K.tolist(), again.D.tolist()) == (camera.K.tolist(), camera.D.tolist())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (xml(False), "no image_width in it; add the size of the sensor"),
        (kalibr(distortion_model="fov"), "unknown distortion model 'fov'"),
        (kalibr(camera_model="omni"), "'omni': only pinhole"),
        (kalibr(intrinsics=[1, 2]), "intrinsics has 2 numbers, not 4"),
        (json.dumps({"cam0": {"intrinsics": []}, "cam1": {"intrinsics": []}}), "2 cameras: cam0, cam1; leave the one"),
        (dv(focalLength="f"), "focalLength is .*, not numbers"),
        ('{"cameras": []}', "DV file without one camera"),
        (basalt("ds"), "basalt camera_type 'ds': known are pinhole"),
        (basalt("kb4"), "intrinsics fx fy cx cy k1 k2 k3 k4 is .*not numbers|not a row of finite"),
        ("1 FOV 240 180 1 2 3 4 5\n", "COLMAP model FOV"),
        ("1 PINHOLE 240 180 1 2\n", "parameters has 2 numbers, not 4"),
        (f"a: {{K: {K}}}\nb: {{K: {K}}}\n", "several cameras in one file: a, b"),
        ("<a><b>", "not an XML file"),
        ("a: 1\nb: 2\n", "no camera matrix .camera_matrix. in it, only a, b"),
        (ros("plumb_bob", [*D, 0, 0, 0, 1e-3]), "plumb_bob takes 4 or 5 coefficients, got 8, not all zero"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path, text, message):
    path = tmp_path / "calibration"
    path.write_text(text)
    with pytest.raises(CameraError, match=message) as caught:
        Camera.read_yaml(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert "Error" not in str(caught.value)
