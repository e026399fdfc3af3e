"""Exact tracks give the exact motion for axes in all directions, near the view too; what no track can tell is named."""

import numpy as np
import pytest
from scenes import backend_for, spin, tracks_of, unit

from esfo_backend.options import BackendOptions, InitialisationOptions
from esfo_core.orbit import angle_between, rotation

DIRECT = BackendOptions(initialisation=InitialisationOptions(method="direct"))
VIEW = unit(0.1, 0.05, 4.0)
STEPS = (-1, 0, 1)
AXES = [unit(x, y, z) for x in STEPS for y in STEPS for z in STEPS if (z, y, x) > (0, 0, 0)]
"""13 directions of a cube, one of each opposite two: axes of the camera, orbits in vertical planes, oblique ones."""


@pytest.mark.parametrize(("axis", "sense"), [(axis, (-1) ** k) for k, axis in enumerate(AXES)], ids=str)
def test_an_axis_in_any_direction(axis, sense):
    estimate = backend_for(tracks_of(spin(sense * axis), points=80), options=DIRECT).solve()
    assert estimate.status == "ok", estimate.reason
    assert estimate.spin.rate_hz == pytest.approx(0.5, rel=1e-6)
    assert angle_between(estimate.spin.axis, sense * axis) < 1e-3


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("off_deg", [0.5, 2.0, 5.0, 12.0])
def test_an_axis_near_the_view(off_deg, sense):
    """Noise of half a pixel; the middle of the ball lies on the axis."""
    aside = np.cross(VIEW, unit(1, 2, 0.3))
    axis = sense * (rotation(aside / np.linalg.norm(aside), np.radians(off_deg)) @ VIEW)
    estimate = backend_for(tracks_of(spin(axis), points=120, noise_px=0.5), options=DIRECT).solve()
    if "axis_unobservable" in estimate.flags:
        assert off_deg < 2
        return
    assert estimate.status == "ok", estimate.reason
    assert angle_between(estimate.spin.axis, axis) < 3.5 * estimate.axis_std_deg
    assert abs(estimate.spin.rate_hz - 0.5) < 3.5 * estimate.rate_std_hz
    assert np.linalg.norm(estimate.points, axis=1).max() < 2 * np.linalg.norm(estimate.spin.center)


@pytest.mark.parametrize("sense", [1, -1])
def test_an_axis_along_the_view_is_named(sense):
    estimate = backend_for(tracks_of(spin(sense * VIEW), points=120, noise_px=0.5), options=DIRECT).solve()
    assert (estimate.status, estimate.flags[0]) == ("degenerate", "axis_unobservable")
    assert abs(estimate.spin.rate_hz - 0.5) < 3.5 * estimate.rate_std_hz


@pytest.mark.parametrize("axis", [unit(0.3, -0.8, 0.4), unit(0, 1, 0), unit(-0.5, -0.5, 0.7)], ids=str)
@pytest.mark.parametrize("turns", [0.5, 0.8, 1.0, 1.05])
def test_one_turn_is_too_few_and_called_so(axis, turns):
    scene = tracks_of(spin(axis), points=100, noise_px=0.5, duration_s=2 * turns)
    estimate = backend_for(scene, 2 * turns, DIRECT).solve()
    assert estimate.status != "ok"
    assert "too_few_turns" in estimate.flags, (estimate.flags, estimate.reason)


def test_a_turn_and_a_quarter_is_enough():
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)), points=100, noise_px=0.5, duration_s=2.5)
    estimate = backend_for(scene, 2.5, DIRECT).solve()
    assert estimate.status == "ok", estimate.reason
    assert abs(estimate.spin.rate_hz - 0.5) < 3.5 * estimate.rate_std_hz


@pytest.mark.parametrize(("radius", "ambiguous"), [(0.35, False), (0.02, True)])
def test_a_small_image_has_a_mirrored_twin(radius, ambiguous):
    """Without perspective a spin seen from above and the opposite one seen from below look the same."""
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)), points=100, noise_px=0.5, object_radius=radius)
    estimate = backend_for(scene, options=DIRECT).solve()
    assert ("mirror_ambiguous" in estimate.flags) == ambiguous
    (mirror,) = (a for a in estimate.alternatives if a.kind == "mirror")
    assert mirror.axis @ estimate.spin.axis < 0
    assert (mirror.score_ratio < 1.1) == ambiguous
