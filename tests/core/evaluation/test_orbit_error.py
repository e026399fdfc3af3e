"""Errors of an estimate against hand-made truths."""

from __future__ import annotations

import numpy as np
import pytest

from esfo_core.camera import Camera
from esfo_core.errors import EsfoError
from esfo_core.evaluation.orbit_error import Evaluation, EvaluationError, compare

TRUTH = {"spin_rate_hz": 0.5, "axis": [0.0, 1.0, 0.0], "center": [0.0, 0.0, 4.0]}
CAMERA = Camera.pinhole(641, 481, 800.0)


def estimate(**changes):
    return {"status": "ok", **TRUTH, **changes}


def tilted(degrees):
    """The true axis turned in the image plane."""
    angle = np.radians(degrees)
    return [np.sin(angle), np.cos(angle), 0.0]


def test_a_perfect_estimate_has_no_error():
    assert compare(estimate(), TRUTH) == Evaluation(0.0, 0.0, None)
    assert compare(estimate(), TRUTH, CAMERA) == Evaluation(0.0, 0.0, 0.0)


@pytest.mark.parametrize("rate", [0.49, 0.51])
def test_rate_error_is_relative_to_the_truth_and_positive(rate):
    assert compare(estimate(spin_rate_hz=rate), TRUTH).rate_error == pytest.approx(0.02, rel=1e-12)
    assert compare(estimate(), {**TRUTH, "spin_rate_hz": 5.0}).rate_error == pytest.approx(0.9, rel=1e-12)


@pytest.mark.parametrize("degrees", [1e-7, 0.3, 90.0, 179.0])
def test_axis_error_is_the_angle_between_the_axes(degrees):
    assert compare(estimate(axis=tilted(degrees)), TRUTH).axis_error_deg == pytest.approx(degrees, rel=1e-9)


def test_the_opposite_spin_is_wrong_by_half_a_turn():
    assert compare(estimate(axis=[0.0, -1.0, 0.0]), TRUTH).axis_error_deg == 180.0


def test_a_negative_rate_about_the_opposite_axis_is_the_same_motion():
    turned = {"axis": [0.0, -1.0, 0.0], "spin_rate_hz": -0.5}
    assert compare(estimate(**turned), TRUTH, CAMERA) == Evaluation(0.0, 0.0, 0.0)
    assert compare(estimate(), {**TRUTH, **turned}, CAMERA) == Evaluation(0.0, 0.0, 0.0)
    assert compare(estimate(spin_rate_hz=-0.5), TRUTH).axis_error_deg == 180.0


def test_axes_of_any_length_and_centres_of_any_scale_are_compared():
    other = compare(estimate(axis=[0.0, 7.0, 0.0], center=[0.0, 0.0, 400.0]), TRUTH, CAMERA)
    assert other == Evaluation(0.0, 0.0, 0.0)


def test_screw_line_error_of_a_parallel_axis_is_its_shift_in_pixels():
    # 0.01 beside the true axis at distance 4 is 0.01 / 4 * 800 = 2 pixels, and its height on the axis is no matter
    error = compare(estimate(center=[0.01, 0.3, 4.0]), TRUTH, CAMERA).screw_line_error_px
    assert error == pytest.approx(2.0, rel=1e-12)


def test_screw_line_error_of_a_tilt_is_its_mean_arm():
    # samples evenly up to 0.25 * 4 = 1 from the centre, 200 pixels; the mean of |s| over 64 even samples is 32 / 63
    error = compare(estimate(axis=tilted(1.0)), TRUTH, CAMERA).screw_line_error_px
    assert error == pytest.approx(np.sin(np.radians(1.0)) * 200 * 32 / 63, rel=1e-9)


def test_screw_line_error_sees_through_lens_distortion():
    bent = Camera(641, 481, CAMERA.K, "plumb_bob", np.array([-0.2, 0.05, 1e-3, -1e-3]))
    assert compare(estimate(), TRUTH, bent).screw_line_error_px == pytest.approx(0.0, abs=1e-6)
    shifted = compare(estimate(center=[0.01, 0.0, 4.0]), TRUTH, bent).screw_line_error_px
    assert shifted == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize(
    ("of_estimate", "of_truth"),
    [
        ({"axis": [0.0, 0.0, 1.0]}, {}),  # estimated axis through the camera: its image is a point
        ({}, {"axis": [0.0, 0.0, 1.0]}),  # true axis through the camera
        ({}, {"center": [40.0, 0.0, 4.0]}),  # true axis outside the image
    ],
)
def test_no_screw_line_no_error_of_it(of_estimate, of_truth):
    assert compare(estimate(**of_estimate), {**TRUTH, **of_truth}, CAMERA).screw_line_error_px is None


def test_a_failed_estimate_is_not_evaluated():
    with pytest.raises(EvaluationError, match="has failed: no tracks"):
        compare(estimate(status="failed", reason="no tracks"), TRUTH)
    with pytest.raises(EvaluationError, match="no status"):
        compare(TRUTH, TRUTH)
    assert issubclass(EvaluationError, EsfoError)


def test_a_degenerate_estimate_is_evaluated():
    assert compare(estimate(status="degenerate"), TRUTH).rate_error == 0


@pytest.mark.parametrize("name", ["spin_rate_hz", "axis", "center"])
@pytest.mark.parametrize("bad", ["missing", None, "north", [1.0, 2.0], [0.0, float("nan"), 1.0], {}, [[1.0, 2.0, 3.0]]])
def test_missing_and_impossible_fields_are_named(name, bad):
    broken = {k: v for k, v in TRUTH.items() if k != name} if bad == "missing" else {**TRUTH, name: bad}
    with pytest.raises(EvaluationError, match=f"truth.*{name}"):
        compare(estimate(), broken)
    with pytest.raises(EvaluationError, match=f"estimate.*{name}") as caught:
        compare({"status": "ok", **broken}, TRUTH)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("still", [{"spin_rate_hz": 0.0}, {"axis": [0.0, 0.0, 0.0]}])
def test_what_does_not_spin_cannot_be_compared(still):
    with pytest.raises(EvaluationError, match="truth does not spin"):
        compare(estimate(), {**TRUTH, **still})
