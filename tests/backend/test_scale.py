"""A known length makes the result metric."""

import numpy as np
import pytest
from scenes import backend_for, spin, tracks_of, unit

from esfo_backend.backend import Backend
from esfo_backend.options import BackendOptions, InitialisationOptions, ScaleOptions
from esfo_backend.scale import diameter
from esfo_core.camera import Camera
from esfo_core.errors import OptionError
from esfo_core.options import parse_assignments, replace

AXIS = unit(0.3, -0.8, 0.4)
DIRECT = BackendOptions(initialisation=InitialisationOptions(method="direct"))


@pytest.fixture(scope="module")
def scene():
    return tracks_of(spin(AXIS), points=120)


def true_lengths(scene):
    center = scene.spin.center
    return {
        # The published centre is the point of the axis nearest the middle of the points, whose height is an estimate.
        "scale.distance_m": np.linalg.norm(center),
        "scale.radius_m": np.linalg.norm(center - (center @ AXIS) * AXIS),
        "scale.size_m": np.linalg.norm(scene.points[:, None] - scene.points, axis=2).max(),
    }


@pytest.mark.parametrize("name", ["scale.distance_m", "scale.radius_m", "scale.size_m"])
def test_lengths_are_those_of_the_truth(scene, name):
    length = true_lengths(scene)[name]
    options = replace(DIRECT, parse_assignments([f"{name}:={length}"]))
    estimate = backend_for(scene, options=options).solve()
    assert estimate.status == "ok", estimate.reason
    assert estimate.scale == "metric"
    assert "scale_unobservable" not in estimate.flags
    orbit, true = estimate.spin.paper_orbit(), scene.spin.paper_orbit()
    # Points that are not seen, and the middle of those that are: a few percent for distance and size, exact for radius.
    assert orbit.radius == pytest.approx(true.radius, rel=1e-6 if name == "scale.radius_m" else 0.05)
    assert estimate.to_json({})["radius"] == orbit.radius
    found = {
        "scale.distance_m": np.linalg.norm(estimate.spin.center),
        "scale.radius_m": orbit.radius,
        "scale.size_m": diameter(estimate.points),
    }
    assert found[name] == pytest.approx(length, rel=1e-9)


def test_the_rest_stays_what_it_was(scene):
    unknown = backend_for(scene, options=DIRECT).solve()
    metric = backend_for(scene, options=replace(DIRECT, {"scale.radius_m": 7.0})).solve()
    assert unknown.scale == "unit"
    assert "scale_unobservable" in unknown.flags
    assert np.array_equal(metric.spin.axis, unknown.spin.axis)
    assert metric.spin.rate_hz == unknown.spin.rate_hz
    np.testing.assert_allclose(metric.points, 7 * unknown.points, rtol=1e-12)
    np.testing.assert_allclose(metric.spin.center, 7 * unknown.spin.center, rtol=1e-12)


def test_two_lengths_are_refused_by_name():
    options = BackendOptions(scale=ScaleOptions(distance_m=2.0, size_m=1.0))
    with pytest.raises(OptionError, match=r"scale\.distance_m = 2\.0, scale\.size_m = 1\.0"):
        Backend(Camera.pinhole(64, 48, 60.0), options)


def test_diameter_of_few_or_flat_points():
    assert diameter(np.zeros((1, 3))) == 0.0
    assert diameter(np.array([[0.0, 0, 0], [3, 4, 0]])) == 5.0
    square = np.array([[0.0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
    assert diameter(square) == pytest.approx(np.sqrt(2))
