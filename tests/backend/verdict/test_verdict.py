"""Every verdict on evidence that has it and on evidence that does not; and small scenes through the real front-end."""

from dataclasses import replace

import numpy as np
import pytest

from esfo_backend.adjustment.covariance import MotionCovariance
from esfo_backend.options import BackendOptions, InitialisationOptions, VerdictOptions
from esfo_backend.verdict.rate_slope import RateSlope
from esfo_backend.verdict.rigidity import Rigidity
from esfo_backend.verdict.verdict import Evidence, judge
from esfo_bringup.benchmark.orbit_accuracy import backend_of, track
from esfo_core.estimate import Alternative
from esfo_simulation.scene import MotionOptions, SceneOptions, simulate

GOOD = Evidence(
    rate_hz=0.5,
    axis=np.array([0.0, 1.0, 0.0]),
    towards=np.array([0.0, 0.0, 1.0]),
    covariance=MotionCovariance(1e-5, np.eye(2) * np.radians(0.1) ** 2),
    points=100,
    reobserved=50,
    reobservable=100,
    inliers=0.9,
    alternatives=(Alternative("mirror", 0.5, np.array([0.0, -1.0, 0.0]), 3.0),),
    harmonic_z=30.0,
    rate_slope=RateSlope(0.0, 1e-5),
    rigidity=Rigidity(0.0, 0.0, 0.0, 0.0, 0.0),
    revolutions=2.5,
    duration_s=5.0,
)
BEFORE_VIEW = np.array([0.0, np.sin(0.02), np.cos(0.02)])


def test_good_evidence_is_ok():
    verdict = judge(GOOD, VerdictOptions())
    assert (verdict.status, verdict.flags, verdict.reason) == ("ok", ("scale_unobservable",), "")


@pytest.mark.parametrize(
    ("change", "status", "flag"),
    [
        ({"rigidity": Rigidity(0.5, 10.0, 0.0, 0.0, 0.0)}, "degenerate", "not_a_rotation"),
        ({"rigidity": Rigidity(0.0, 0.0, 1.0, 10.0, 0.001)}, "degenerate", "not_a_rotation"),
        ({"rate_slope": RateSlope(-0.01, 1e-4)}, "degenerate", "rate_not_constant"),
        ({"revolutions": 0.9}, "degenerate", "too_few_turns"),
        ({"axis": BEFORE_VIEW, "covariance": MotionCovariance(1e-5, np.eye(2) * 0.02**2)}, "degenerate", "axis"),
        ({"covariance": MotionCovariance(1e-5, np.eye(2) * 0.1**2)}, "degenerate", "axis_unobservable"),
        ({"harmonic_z": 7.0}, "ok", "harmonic_ambiguous"),
        ({"alternatives": (Alternative("mirror", 0.5, np.ones(3), 1.05),)}, "ok", "mirror_ambiguous"),
        ({"points": 9}, "failed", "too_few_points"),
        ({"reobserved": 4}, "failed", None),
        ({"reobserved": 4, "revolutions": 0.9}, "failed", "too_few_turns"),
        ({"inliers": 0.2}, "failed", None),
        ({"covariance": MotionCovariance(0.02, np.eye(2) * 1e-6)}, "failed", None),
        ({"covariance": MotionCovariance(0.0105, np.eye(2) * 1e-6)}, "failed", None),  # 2.1 % of the rate
        (
            {"axis": BEFORE_VIEW, "covariance": MotionCovariance(1e-5, np.eye(2) * 0.0068**2)},
            "degenerate",
            "axis_unobs",
        ),
        ({"covariance": MotionCovariance(np.nan, np.full((2, 2), np.nan))}, "failed", None),
    ],
)
def test_each_doubt_has_its_name(change, status, flag):
    verdict = judge(replace(GOOD, **change), VerdictOptions())
    assert verdict.status == status
    assert flag is None or any(f.startswith(flag) for f in verdict.flags)
    assert bool(verdict.reason) == (status != "ok")


WANDERS = Rigidity(0.5, 10.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(("reobserved", "status"), [(50, "degenerate"), (49, "failed"), (None, "degenerate")])
def test_no_numbers_come_of_a_motion_that_does_not_repeat(reobserved, status):
    """Of 100 points: most came back to their places, most did not, or nobody looked."""
    verdict = judge(replace(GOOD, reobserved=reobserved, rigidity=WANDERS), VerdictOptions())
    assert (verdict.status, verdict.flags[0]) == (status, "not_a_rotation")
    assert "axis direction varies" in verdict.reason
    assert judge(replace(GOOD, reobserved=reobserved), VerdictOptions()).status == "ok"


def test_doubts_that_rest_on_a_period_that_no_point_confirms_are_not_named():
    drifts = {"rate_slope": RateSlope(-0.01, 1e-4), "rigidity": WANDERS, "reobserved": 4}
    verdict = judge(replace(GOOD, **drifts), VerdictOptions())
    assert (verdict.status, verdict.flags) == ("failed", ())
    assert "observed again one revolution later" in verdict.reason


@pytest.mark.parametrize(
    "change",
    [
        {"rigidity": Rigidity(0.5, 3.0, 0.2, 30.0, 0.001)},  # not significant; significant, and too small to matter
        {"rate_slope": RateSlope(-0.01, 0.005)},
        {"rate_slope": RateSlope(-1e-4, 1e-6)},
        {"axis": BEFORE_VIEW, "covariance": MotionCovariance(1e-5, np.eye(2) * 0.0065**2)},  # 0.02 is 3.1 deviations
        {"covariance": MotionCovariance(0.0095, np.eye(2) * 1e-6)},  # 1.9 % of the rate
    ],
)
def test_what_is_insignificant_or_small_is_no_doubt(change):
    assert judge(replace(GOOD, **change), VerdictOptions()).status == "ok"


SMALL = SceneOptions(width=240, height=180, rate_hz=1.0, revolutions=2.3)


def seen(options):
    """Solve a simulated scene through the real front-end."""
    scene = simulate(options)
    direct = BackendOptions(initialisation=InitialisationOptions(method="direct"))
    return backend_of(track(scene.chunks(), scene.camera), scene.camera, direct).solve()


def test_a_slow_slide_leaves_a_rate_that_its_deviation_covers():
    estimate = seen(far(SMALL, 1.3, velocity_x_m_s=0.002))
    assert "not_a_rotation" in estimate.flags
    assert estimate.spin is None or abs(estimate.spin.rate_hz - 1) < 3 * estimate.rate_std_hz


def far(options, factor, **motion):
    """A scene with room to move in; velocities in distances per second."""
    distance = float(np.linalg.norm(simulate(options).spin.center))
    scaled = {name: value * distance if "velocity" in name else value for name, value in motion.items()}
    return replace(options, distance_m=factor * distance, motion=MotionOptions(**scaled))


def test_a_fixed_axis_is_ok():
    estimate = seen(SMALL)
    assert estimate.status == "ok", estimate.reason
    assert abs(estimate.spin.rate_hz - 1) < 3 * estimate.rate_std_hz


STILL = {"rate_hz": 0.0, "speed": "still"}
NO_FIXED_AXIS = {
    "tumbling": (lambda: replace(SMALL, motion=MotionOptions(nutation_deg=12)), "not_a_rotation"),
    "tumbling a little": (  # twice its period suits it nearly
        lambda: SceneOptions(
            object="tdrs",
            view="perpendicular",
            speed="fast",
            width=346,
            height=260,
            motion=MotionOptions(nutation_deg=2.0, inertia_ratio=0.8),
        ),
        "not_a_rotation",
    ),
    "across": (lambda: far(SMALL, 1.4, velocity_x_m_s=0.02), "not_a_rotation"),
    "towards": (lambda: far(SMALL, 1.4, velocity_z_m_s=0.04), "not_a_rotation"),
    "sliding nearer": (
        lambda: replace(far(SMALL, 1.6, velocity_x_m_s=0.06, velocity_z_m_s=-0.1), duration_s=2.0, **STILL),
        "not_a_rotation",
    ),
    "static": (lambda: replace(SMALL, duration_s=1.0, **STILL), "too_few_tracks"),
    "slowing": (lambda: replace(SMALL, motion=MotionOptions(rate_slope_hz_s=-0.12)), "rate_not_constant"),
    "along the view": (
        lambda: replace(SMALL, view="custom", elevation_deg=89.0, roll_deg=10.0),
        "axis_unobservable",
    ),
    "half a turn": (lambda: replace(SMALL, revolutions=0.5), "too_few_turns"),
    "0.9 turns of a flat body from the side": (
        lambda: replace(SMALL, object="dualshock", view="sideon", revolutions=0.9),
        "too_few_turns",
    ),
}


@pytest.mark.parametrize("case", NO_FIXED_AXIS)
def test_what_is_no_fixed_axis_at_a_constant_rate_is_named(case):
    scene, flag = NO_FIXED_AXIS[case]
    estimate = seen(scene())
    assert estimate.status != "ok"
    assert flag in estimate.flags, (estimate.flags, estimate.reason)
    assert estimate.reason
    assert estimate.spin is None or flag != "not_a_rotation"  # it has no one rate, so none is given
