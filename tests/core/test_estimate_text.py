"""The text of an estimate: what a log line, the terminal and the report say of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from esfo_core.estimate import OrbitEstimate
from esfo_core.estimate_text import facts, one_line, printed_facts
from esfo_core.orbit import Spin

ESTIMATE = OrbitEstimate(
    status="ok",
    flags=("scale_unobservable",),
    reason="",
    spin=Spin(np.array([0.6, -0.8, 0.0]), 0.5, np.array([0.1, -0.25, 4.0]), 0),
    level="orbit",
    rate_hz=0.5,
    rate_std_hz=0.000125,
    axis_cov=np.diag(np.radians([0.1, 0.2]) ** 2),
    points=np.zeros((5, 3)),
    point_rms_px=np.full(5, 0.4),
    point_observations=np.full(5, 9),
    tracks=7,
    observations=45,
    revolutions=2.5,
    rms_px=0.41,
    initialisation="colmap",
)


def test_one_line_has_rate_axis_points_and_error():
    assert one_line(ESTIMATE) == (
        "ok (scale_unobservable): 0.50000 +- 0.00013 Hz, axis [0.6000, -0.8000, 0.0000] +- 0.20 deg, 5 points, 0.41 px"
    )


def test_one_line_takes_the_number_of_points_that_are_not_there():
    assert ", 31 points, " in one_line(replace(ESTIMATE, points=np.empty((0, 3)), flags=()), points=31)


def test_one_line_of_a_failure_says_why():
    assert one_line(OrbitEstimate.failure("no activity")) == "failed: no activity"


def test_facts_are_named_and_have_units():
    assert facts(ESTIMATE, "2 of 9 views") == {
        "spin rate": "0.500000 Hz +- 0.000125  (30.000 rpm)",
        "axis": "(+0.6000, -0.8000, +0.0000) +- 0.200 deg, camera frame",
        "centre": "(+0.1000, -0.2500, +4.0000), in orbit radii",
        "structure": "5 points from 7 tracks, 45 observations, 2.50 turns, 0.41 px RMS",
        "initialised": "by colmap (2 of 9 views)",
        "status": "ok [scale_unobservable]",
    }


def test_a_rate_slope_and_metres_are_named_where_they_are_known():
    found = facts(replace(ESTIMATE, rate_slope_hz_s=-0.002, rate_slope_std_hz_s=0.0001, scale="metric"))
    assert found["rate slope"] == "-2.00e-03 Hz/s +- 1.0e-04"
    assert found["centre"].endswith("in metres")
    assert found["initialised"] == "by colmap"


def test_facts_of_a_failure_are_its_status_alone():
    assert facts(OrbitEstimate.failure("no activity", flags=("no_period",))) == {"status": "failed [no_period]"}


def test_a_command_prints_the_main_facts_in_a_column():
    lines = printed_facts(ESTIMATE, "2 of 9 views")
    assert [line[:12].strip() for line in lines] == ["spin rate", "axis", "structure", "initialised", "status"]
    assert lines[-2:] == ["initialised by colmap (2 of 9 views)", "status      ok [scale_unobservable]"]
    assert printed_facts(OrbitEstimate.failure("no activity")) == ["status      failed"]
