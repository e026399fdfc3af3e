"""Intrinsics, lens distortion and the calibration file."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_core.camera import Camera
from esfo_core.errors import CameraError

K = np.array([[300.5, 0, 170], [0, 301.25, 128.25], [0, 0, 1]])
LENSES = {
    "none": ("plumb_bob", []),
    "plumb_bob of 4": ("plumb_bob", [-0.31, 0.12, 1.5e-3, -8e-4]),
    "plumb_bob": ("plumb_bob", [-0.31, 0.12, 1.5e-3, -8e-4, -0.02]),
    "rational_polynomial": ("rational_polynomial", [0.2, -0.1, 1e-3, -2e-3, 0.01, 0.45, 0.02, -0.005]),
    "equidistant": ("equidistant", [-0.02, 0.004, -0.003, 0.0005]),
    "equidistant of zeros": ("equidistant", [0.0, 0.0, 0.0, 0.0]),
}


def camera(model="plumb_bob", D=(), width=346, height=260):
    return Camera(width, height, K, model, np.array(D, np.float64))


def same(a, b):
    return (a.width, a.height, a.distortion_model) == (b.width, b.height, b.distortion_model) and (
        a.K.tobytes() + a.D.tobytes() == b.K.tobytes() + b.D.tobytes()
    )


@pytest.fixture(params=LENSES)
def lens(request):
    return camera(*LENSES[request.param])


def test_pinhole_has_its_principal_point_in_the_middle_of_the_pixel_centres():
    ideal = Camera.pinhole(640, 480, 800.0)
    assert ideal.K.tolist() == [[800, 0, 319.5], [0, 800, 239.5], [0, 0, 1]]
    assert ideal.project(np.array([[0, 0, 5.0], [1, -0.5, 4.0]])).tolist() == [[319.5, 239.5], [519.5, 139.5]]
    assert ideal.unproject(np.array([[519.5, 139.5]])).tolist() == [[0.25, -0.125]]
    assert camera().focal_px == 300.875


def test_plumb_bob_against_the_formula_worked_by_hand():
    # x = 0.5, y = 0.25: r2 = 0.3125, r4 = 0.09765625, r6 = 0.030517578125, 2xy = 0.25
    # radial = 1 + 0.1 * 0.3125 - 0.2 * 0.09765625 + 0.3 * 0.030517578125 = 1.0208740234375
    # x' = 0.5 radial + 0.01 * 0.25 + 0.02 * (0.3125 + 0.5)     = 0.51043701171875 + 0.0025 + 0.01625
    # y' = 0.25 radial + 0.01 * (0.3125 + 0.125) + 0.02 * 0.25  = 0.255218505859375 + 0.004375 + 0.005
    distorted = camera("plumb_bob", [0.1, -0.2, 0.01, 0.02, 0.3]).distort(np.array([[0.5, 0.25]]))
    np.testing.assert_allclose(distorted, [[0.52918701171875, 0.264593505859375]], rtol=1e-15)


def test_rational_polynomial_against_the_formula_worked_by_hand():
    # x = 1, y = 0: r2 = 1, radial = (1 + 0.1 + 0.2 + 0.3) / (1 + 0.4 + 0.5 + 0.1) = 0.8
    # x' = 0.8 + 0.02 * (1 + 2), y' = 0.01 * 1
    distorted = camera("rational_polynomial", [0.1, 0.2, 0.01, 0.02, 0.3, 0.4, 0.5, 0.1]).distort(
        np.array([[1.0, 0.0]])
    )
    np.testing.assert_allclose(distorted, [[0.86, 0.01]], rtol=1e-15)


def test_equidistant_against_the_formula_worked_by_hand():
    # x = 0, y = -1: theta = pi / 4
    q = (np.pi / 4) ** 2
    expected = np.pi / 4 * (1 + 0.1 * q + 0.02 * q**2 - 0.03 * q**3 + 0.004 * q**4)
    lens = camera("equidistant", [0.1, 0.02, -0.03, 0.004])
    np.testing.assert_allclose(lens.distort(np.array([[0.0, -1.0]])), [[0, -expected]], rtol=1e-15)
    assert lens.distort(np.zeros((1, 2))).tolist() == [[0, 0]]


def test_equidistant_with_zeros_is_no_pinhole():
    # the image radius is the angle: a ray 60 degrees off the axis comes pi / 3 focal lengths from the centre
    x = np.tan(np.pi / 3)
    uv = camera("equidistant", [0, 0, 0, 0]).project(np.array([[x, 0, 1.0]]))
    np.testing.assert_allclose(uv, [[170 + 300.5 * np.pi / 3, 128.25]], rtol=1e-14)


@pytest.mark.parametrize("model", ["plumb_bob", "rational_polynomial", "equidistant", "anything"])
def test_without_coefficients_every_model_is_a_pinhole(model):
    xy = np.array([[0.3, -0.2], [2.0, 1.0]])
    assert (camera(model).distort(xy) == xy).all()


def test_unproject_undoes_project(lens):
    rng = np.random.default_rng(3)
    uv = rng.uniform([0, 0], [lens.width - 1, lens.height - 1], (500, 2))
    X = np.concatenate([lens.unproject(uv), np.ones((500, 1))], axis=1) * rng.uniform(0.1, 50, (500, 1))
    np.testing.assert_allclose(lens.project(X), uv, atol=1e-8)
    corner = np.array([[0.45, 0.4]])
    np.testing.assert_allclose(
        lens.unproject(lens.distort(corner) * np.diag(K)[:2] + K[:2, 2]), corner, atol=1e-11, rtol=0
    )


@settings(deadline=None)  # a busy machine is no failure
@given(st.floats(0.0, np.radians(88.0)), st.floats(0.0, 2 * np.pi))
def test_wide_fisheye_rays_come_back(angle, direction):
    lens = camera("equidistant", [-0.02, 0.004, -0.003, 0.0005])
    xy = np.tan(angle) * np.array([[np.cos(direction), np.sin(direction)]])
    back = lens.unproject(lens.project(np.append(xy, [[1.0]], axis=1)))
    turned = np.degrees(np.arctan(np.linalg.norm(back)) - angle)
    assert abs(turned) < 1e-9
    np.testing.assert_allclose(back, xy, rtol=1e-8, atol=1e-12)


def test_ray_table_holds_every_pixel(lens):
    table = lens.rays
    assert table.shape == (260, 346, 2)
    assert lens.rays is table
    for u, v in ((0, 0), (345, 0), (0, 259), (200, 31)):
        np.testing.assert_allclose(lens.project(np.array([[*table[v, u], 1.0]])), [[u, v]], atol=1e-8)


def test_no_pixel_no_ray(lens):
    assert lens.unproject(np.empty((0, 2), np.float32)).shape == (0, 2)
    assert lens.project(np.empty((0, 3))).shape == (0, 2)


@pytest.mark.parametrize(
    ("model", "D", "message"),
    [
        ("plumb_bob", [-2.0, 0, 0, 0], "cannot be inverted"),  # largest image radius 0.27, the corners are at 0.71
        ("equidistant", [-0.6, 0, 0, 0], "cannot be inverted"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_distortion_without_an_inverse_is_an_error(model, D, message):
    lens = camera(model, D)
    with pytest.raises(CameraError, match=message):
        lens.rays  # noqa: B018


def test_a_point_of_a_second_branch_is_an_error():
    # r - 1.2 r^3 + 0.6 r^5 rises to 0.390 at r = 0.66, falls to 0.379 at 0.87 and reaches 0.45 only at 1.07
    folded = camera("plumb_bob", [-1.2, 0.6, 0, 0])
    assert folded.unproject(np.array([[170 + 300.5 * 0.35, 128.25]]))[0, 0] < 0.66
    with pytest.raises(CameraError, match="folds the image"):
        folded.unproject(np.array([[170 + 300.5 * 0.45, 128.25]]))


def test_pixels_that_see_behind_the_camera_are_an_error():
    fisheye = camera("equidistant", [0, 0, 0, 0], width=1400)
    with pytest.raises(CameraError, match="cannot be inverted"):  # (1000 - 170) / 300.5 rad = 158 degrees off the axis
        fisheye.unproject(np.array([[1000.0, 128.0]]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width": 0}, "image size 0x260"),
        ({"height": -3}, "image size 346x-3"),
        ({"K": np.eye(2)}, "not 3x3"),
        ({"K": K * np.nan}, "not 3x3 of finite"),
        ({"K": np.diag([0.0, 0, 1])}, "focal lengths 0.0, 0.0 are not positive"),
        ({"K": np.diag([300.0, -300, 1])}, "focal lengths 300.0, -300.0"),
        ({"K": K.T}, "skew or a last row"),
        ({"K": K + np.outer([1, 0, 0], [0, 2, 0])}, "skew"),
        ({"D": np.array([0.1, np.inf, 0, 0])}, "not a row of finite"),
        ({"D": np.zeros((1, 4))}, "not a row"),
        ({"D": np.array([0.1, 0, 0, 0, 0, 1e-9])}, "plumb_bob takes 4 or 5 coefficients, got 6, not all zero"),
        ({"distortion_model": "equidistant", "D": np.full(5, 0.1)}, "equidistant takes 4 coefficients, got 5"),
        ({"distortion_model": "rational_polynomial", "D": np.full(9, 0.1)}, "takes 8"),
        ({"distortion_model": "fov", "D": np.full(4, 0.1)}, "unknown distortion model 'fov'"),
        ({"distortion_model": "fov", "D": np.zeros(4)}, "unknown distortion model 'fov'"),
    ],
)
def test_impossible_cameras(change, message):
    with pytest.raises(CameraError, match=message):
        Camera(**{"width": 346, "height": 260, "K": K, **change})


def test_file_round_trip_is_exact(lens, tmp_path):
    path = tmp_path / "camera.yaml"
    lens.write_yaml(path, "event: camera #1")
    assert same(Camera.read_yaml(path), lens)
    content = yaml.safe_load(path.read_text())
    assert content["camera_name"] == "event: camera #1"
    assert content["distortion_coefficients"]["cols"] == len(lens.D)
    assert np.reshape(content["projection_matrix"]["data"], (3, 4))[:, :3].tolist() == K.tolist()
    assert content["rectification_matrix"]["data"] == np.eye(3).ravel().tolist()


@settings(deadline=None)  # a busy machine is no failure
@given(
    st.lists(st.floats(1e-3, 1e6), min_size=2, max_size=2),
    st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=2),
    st.lists(st.floats(-1e300, 1e300), min_size=5, max_size=5),
)
def test_any_number_survives_the_file(tmp_path_factory, focal, centre, D):
    matrix = np.array([[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1]])
    path = tmp_path_factory.mktemp("camera") / "camera.yaml"
    written = Camera(1280, 720, matrix, "plumb_bob", np.array(D))
    written.write_yaml(path)
    assert same(Camera.read_yaml(path), written)


def read(tmp_path, text):
    path = tmp_path / "camera.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return Camera.read_yaml(path)


GOOD = """\
image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [800, 0, 320, 0, 8e2, 240, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, -0.2, 0, 0, 0]}
"""


def test_file_as_people_write_it(tmp_path):
    found = read(tmp_path, GOOD)
    assert (found.width, found.height, found.distortion_model) == (640, 480, "plumb_bob")
    assert found.K.tolist() == [[800, 0, 320], [0, 800, 240], [0, 0, 1]]
    assert found.D.tolist() == [0.1, -0.2, 0, 0, 0]
    short = read(tmp_path, "".join(GOOD.splitlines(keepends=True)[:3]))
    assert (short.distortion_model, len(short.D)) == ("plumb_bob", 0)
    assert read(tmp_path, GOOD.replace("plumb_bob", "''").replace("0.1, -0.2", "0, 0")).distortion_model == "plumb_bob"
    assert read(tmp_path, GOOD.replace(": 640", ": 640.0")).width == 640


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (GOOD, "", "holds no named fields"),
        (GOOD, "just a sentence", "holds no named fields"),
        (GOOD, "[1, 2, 3]", "holds no named fields"),
        (GOOD, "a: [1, 2\nb: {", "not a YAML, JSON or XML file"),
        (GOOD, b"\x89PNG\r\n\x1a\n\x00\xff", "not a YAML, JSON or XML file"),
        (GOOD, "taken: 2024-13-45", "not a YAML, JSON or XML file"),  # the YAML reader's own ValueError
        (GOOD, "[" * 100_000, "not a YAML, JSON or XML file"),  # its recursion
        ("image_width: 640", "", "image_width"),
        ("image_height", "image_hight", "image_height"),
        ("camera_matrix", "matrix", "camera_matrix"),
        ("640", "wide", "image_width is .*wide.*, not numbers"),
        ("640", "[640, 1]", "not a whole number"),
        ("640", "null", "no image_width in it; add the size"),
        ("640", "640.5", "image_width is 640.5, not a whole number"),
        ("640", ".nan", "image_width is nan, not a whole number"),
        ("640", ".inf", "image_width is inf, not a whole number"),
        ("640", "1" + 400 * "0", "image_width is .*, not numbers"),
        ("640", "-640", "image size -640x480"),
        ("[800, 0,", "[.nan, 0,", "finite"),
        ("[800, 0,", "[0, 0,", "focal lengths 0.0, 800.0 are not positive"),
        ("[800, 0,", "[0,", "camera_matrix has 8 numbers, not 9"),
        ("[800, 0,", "[[800], 0,", "camera_matrix is .*, not numbers"),
        ("[800, 0,", "[f, 0,", "camera_matrix is .*, not numbers"),
        ("[800, 0,", "[800, 1,", "skew"),
        ("plumb_bob", "fov", "unknown distortion model 'fov'"),
        ("[0.1, -0.2, 0, 0, 0]", "[0.1, 0, 0, 0, 0, 1]", "takes 4 or 5"),
        ("[0.1, -0.2, 0, 0, 0]", "null", "not a row of finite"),
        ("[0.1, -0.2, 0, 0, 0]", "[.inf, 0, 0, 0]", "finite"),
        ("{rows: 1, cols: 5, data: [0.1, -0.2, 0, 0, 0]}", "{rows: 1}", "distortion_coefficients has no data"),
    ],
)
def test_wrong_files_end_as_one_line_with_the_path(tmp_path, old, new, message):
    text = new if isinstance(new, bytes) else GOOD.replace(old, new)
    with pytest.raises(CameraError, match=message) as caught:
        read(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path / 'camera.yaml'}: ")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600


def test_missing_files(tmp_path):
    with pytest.raises(CameraError, match=r"none\.yaml: No such file"):
        Camera.read_yaml(tmp_path / "none.yaml")
    with pytest.raises(CameraError, match="directory"):
        Camera.read_yaml(tmp_path)
