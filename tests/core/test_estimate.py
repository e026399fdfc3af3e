"""The result file: valid JSON with the promised keys for every status."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from esfo_core.estimate import Alternative, OrbitEstimate, RateEstimate
from esfo_core.orbit import Spin, rotation, tangent_basis

PROMISED = {
    *("status", "flags", "spin_rate_hz", "spin_rate_std_hz", "axis", "axis_std_deg", "center", "radius", "orbit"),
    *("scale", "points", "tracks", "observations", "revolutions", "rms_reprojection_px", "initialisation"),
    *("timing_s", "versions"),
}
BESIDE = {"reason", "t0_ns", "alternatives"}  # why there is no estimate; the time of X in points.ply; what was rejected
BESIDE |= {"level", "rates"}  # how much is known, and the rate from each source alone
BESIDE |= {"spin_rate_slope_hz_s", "spin_rate_slope_std_hz_s"}  # whether the rate is constant
BESIDE |= {"focal_px", "focal_std_px"}  # of a camera that was only assumed

SPIN = Spin(np.array([0.6, 0.8, 0.0]), 0.5, np.array([0.1, 0.0, 4.0]), 1_700_000_000_123_456_789)
VERSIONS = {"esfo": "0.1.0"}


def estimate(**changes):
    values = {
        "status": "ok",
        "flags": ("scale_unobservable",),
        "reason": "",
        "spin": SPIN,
        "level": "orbit",
        "rate_hz": 0.5,
        "rate_std_hz": 1e-4,
        "stream_rate": RateEstimate(0.5001, 2e-4),
        "rate_slope_hz_s": 2e-5,
        "rate_slope_std_hz_s": 1e-5,
        "axis_cov": np.diag([1e-6, 4e-6]),
        "points": np.zeros((5, 3)),
        "point_rms_px": np.full(5, 0.4),
        "point_observations": np.full(5, 9),
        "tracks": 7,
        "observations": 45,
        "revolutions": 2.5,
        "rms_px": 0.41,
        "initialisation": "direct",
        "alternatives": (Alternative("harmonic", 1.0, np.zeros(3), 1.7),),
        "timing_s": {"initialisation": 0.5},
    }
    return OrbitEstimate(**{**values, **changes})


def written(result, tmp_path):
    path = tmp_path / "orbit.json"
    result.write_json(path, VERSIONS)

    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(path.read_text(), parse_constant=refuse)


def test_an_estimate_is_written_with_the_promised_keys_and_values(tmp_path):
    content = written(estimate(), tmp_path)
    assert set(content) == PROMISED | BESIDE
    orbit = content.pop("orbit")
    assert content == {
        "status": "ok",
        "level": "orbit",
        "flags": ["scale_unobservable"],
        "reason": "",
        "spin_rate_hz": 0.5,
        "spin_rate_std_hz": 1e-4,
        "rates": {"stream": {"hz": 0.5001, "std_hz": 2e-4}, "tracks": None},
        "spin_rate_slope_hz_s": 2e-5,
        "spin_rate_slope_std_hz_s": 1e-5,
        "axis": [0.6, 0.8, 0.0],
        "axis_std_deg": pytest.approx(math.degrees(2e-3), rel=1e-12),
        "center": [0.1, 0.0, 4.0],
        "t0_ns": 1_700_000_000_123_456_789,
        "radius": orbit["r"],
        "focal_px": None,
        "focal_std_px": None,
        "scale": "unit",
        "points": 5,
        "tracks": 7,
        "observations": 45,
        "revolutions": 2.5,
        "rms_reprojection_px": 0.41,
        "initialisation": "direct",
        "alternatives": [{"kind": "harmonic", "rate_hz": 1.0, "axis": [0, 0, 0], "score_ratio": 1.7}],
        "timing_s": {"initialisation": 0.5},
        "versions": VERSIONS,
    }


def test_the_written_orbit_is_the_motion(tmp_path):
    orbit = written(estimate(), tmp_path)["orbit"]
    assert set(orbit) == {"r", "f", "R0", "n", "u", "c"}
    n, u, c, R0 = (np.array(orbit[name]) for name in ("n", "u", "c", "R0"))
    assert orbit["f"] == 0.5
    position = c + orbit["r"] * (np.cos(1.0) * u + np.sin(1.0) * np.cross(n, u))  # equation 1 at a phase of 1 rad
    forward = (c - position) / orbit["r"]
    R = R0 @ np.array([np.cross(-n, forward), -n, forward])
    X = np.array([0.2, -0.3, 0.1])
    np.testing.assert_allclose(R @ (X - position), rotation(SPIN.axis, 1.0) @ X + SPIN.center, atol=1e-14)


def test_a_failure_has_the_same_keys_and_invents_no_number(tmp_path):
    content = written(OrbitEstimate.failure("no events were received", tracks=3, flags=("empty",)), tmp_path)
    assert set(content) == PROMISED | BESIDE
    assert (content["status"], content["reason"], content["flags"]) == ("failed", "no events were received", ["empty"])
    assert (content["tracks"], content["points"], content["initialisation"]) == (3, 0, "none")
    absent = {"spin_rate_hz", "spin_rate_std_hz", "axis", "axis_std_deg", "center", "t0_ns", "radius", "orbit"}
    assert {key for key, value in content.items() if value is None} == absent | {
        "rms_reprojection_px",
        "focal_px",
        "focal_std_px",
        "spin_rate_slope_hz_s",
        "spin_rate_slope_std_hz_s",
    }


def test_an_axis_through_the_camera_is_written_without_an_orbit(tmp_path):
    through = Spin(np.array([0, 0, 1.0]), 0.5, np.array([0, 0, 4.0]), 0)
    content = written(estimate(status="degenerate", spin=through), tmp_path)
    assert set(content) == PROMISED | BESIDE
    assert (content["spin_rate_hz"], content["axis"], content["radius"], content["orbit"]) == (0.5, [0, 0, 1], 0, None)


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_no_number_is_null_at_any_depth(bad, tmp_path):
    content = written(
        estimate(
            rate_std_hz=np.float64(bad),
            axis_cov=np.diag([1e-6, bad]),
            rms_px=bad,
            spin=Spin(np.array([bad, 0, 0]), 0.5, np.array([0, 0, 4.0]), 0),
            alternatives=(Alternative("mirror", bad, np.array([bad, 0, 1]), bad),),
            timing_s={"initialisation": bad},
        ),
        tmp_path,
    )
    assert content["spin_rate_std_hz"] is content["axis_std_deg"] is content["rms_reprojection_px"] is None
    assert content["axis"] == [None, 0, 0]
    assert content["alternatives"] == [{"kind": "mirror", "rate_hz": None, "axis": [None, 0, 1], "score_ratio": None}]
    assert content["timing_s"] == {"initialisation": None}


def test_numpy_numbers_are_written_as_numbers(tmp_path):
    numbers = {"tracks": np.int64(7), "observations": np.uint32(45), "revolutions": np.float32(2.5)}
    content = written(estimate(**numbers, timing_s={"initialisation": np.float32(0.5)}), tmp_path)
    assert content == written(estimate(), tmp_path)


def test_axis_deviation_is_that_of_the_worse_direction():
    # standard deviations of 3 and 1 mrad along axes turned by 30 degrees in the tangent plane
    turn = rotation(np.array([0, 0, 1.0]), math.radians(30))[:2, :2]
    cov = turn @ np.diag([9e-6, 1e-6]) @ turn.T
    assert estimate(axis_cov=cov).axis_std_deg == pytest.approx(math.degrees(3e-3), rel=1e-9)
    assert estimate(axis_cov=np.zeros((2, 2))).axis_std_deg == 0


def test_axis_deviation_predicts_the_scatter_of_axes():
    rng = np.random.default_rng(2)
    offsets = rng.multivariate_normal([0, 0], np.diag([4e-6, 1e-8]), 4000)
    axes = SPIN.axis + offsets @ tangent_basis(SPIN.axis).T
    scatter = np.degrees(np.sqrt(np.mean(np.sum(np.cross(axes, SPIN.axis) ** 2, axis=1))))
    # 4000 draws know a standard deviation to 1 / sqrt(8000) = 1.1 %
    assert estimate(axis_cov=np.diag([4e-6, 1e-8])).axis_std_deg == pytest.approx(scatter, rel=0.05)
