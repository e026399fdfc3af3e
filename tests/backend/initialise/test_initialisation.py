"""Which initialisation is taken, and which of COLMAP's models is refused, from models whose faults are known."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import CAMERA, spin, tracks_of, unit

from esfo_backend.adjustment.bundle_adjustment import bundle_adjustment, linear_points
from esfo_backend.errors import BackendError
from esfo_backend.initialise import initialisation
from esfo_backend.initialise.axis_search import AxisSearchResult, directions, search_axis
from esfo_backend.initialise.circle import CameraOrbit, fit_circle, orbit_of_cameras, robust_slope
from esfo_backend.initialise.colmap import ColmapResult
from esfo_backend.initialise.initialisation import Initialisation, initialise
from esfo_backend.options import BackendOptions, InitialisationOptions, SpinRateOptions
from esfo_backend.orbit.observations import observations
from esfo_backend.orbit.parametrization import motion_from_axis
from esfo_core.orbit import angle_between

AXIS = unit(0.3, -0.8, 0.4)


@pytest.fixture(scope="module")
def scene():
    found = tracks_of(spin(AXIS), noise_px=0.3)
    return found, observations(found.tracks, CAMERA, 4)[0]


def model(scene, rate_hz=0.5, circle=0.0, registered=100, axis=AXIS):
    """A model of COLMAP with a known fault."""
    motion = motion_from_axis(axis, scene.spin.center, rate_hz)
    return ColmapResult(CameraOrbit(motion, 2.0, circle, 1e-4), registered, 100, 0.4)


def begun(scene, monkeypatch, found, method, thorough=True, **options):
    def colmap(*_):
        if isinstance(found, BackendError):
            raise found
        return found

    monkeypatch.setattr(initialisation, "run_colmap", colmap)
    truth, obs = scene
    options = BackendOptions(initialisation=InitialisationOptions(method=method), **options)
    return initialise(truth.tracks, obs, CAMERA, 0.5, options, thorough)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({"circle": 0.26}, "off a circle"),
        ({"registered": 24}, "only 24 of 100 views"),
        ({"rate_hz": 0.56}, "0.5600 Hz"),
        ({"rate_hz": 0.44}, "0.4400 Hz"),
    ],
)
def test_a_model_that_is_no_orbit_at_the_rate_is_refused(scene, monkeypatch, fault, message):
    with pytest.raises(BackendError, match=message):
        begun(scene, monkeypatch, model(scene[0], **fault), "colmap")
    searched = begun(scene, monkeypatch, model(scene[0], **fault), "both")
    assert searched.name == "direct"
    assert message in searched.colmap_note
    assert searched.colmap is not None


@pytest.mark.parametrize("nearly", [{"circle": 0.24}, {"registered": 25}, {"rate_hz": 0.54}, {"rate_hz": 0.46}])
def test_a_model_within_the_limits_starts_at_the_rate_of_the_stream(scene, monkeypatch, nearly):
    found = begun(scene, monkeypatch, model(scene[0], **nearly), "colmap")
    assert found.name == "colmap"
    assert found.second is None
    assert found.solution.motion.rate_hz == pytest.approx(0.5, rel=1e-3)
    assert angle_between(found.solution.motion.axis, AXIS) < 0.5
    assert str(found.colmap.registered) in found.colmap_note


def test_the_paper_takes_the_model_as_it_is(scene, monkeypatch):
    paper = {"rate": SpinRateOptions(method="fourier")}
    found = begun(scene, monkeypatch, model(scene[0], 0.9, circle=0.9, registered=5), "colmap", **paper)
    assert found.name == "colmap"


def test_colmap_is_taken_on_a_tie_and_the_search_where_it_is_better(scene, monkeypatch):
    assert begun(scene, monkeypatch, model(scene[0]), "both").name == "colmap"
    worse = search_axis(scene[1], 0.5, InitialisationOptions()).second
    assert worse is not None
    found = begun(scene, monkeypatch, model(scene[0], axis=worse.motion.axis), "both")
    assert found.name == "direct"
    assert "times the cost" in found.colmap_note
    assert angle_between(found.solution.motion.axis, AXIS) < 0.5


def test_colmap_runs_only_where_it_is_asked_for_or_needed(scene, monkeypatch):
    absent = BackendError("COLMAP ran")
    for method, thorough in (("direct", True), ("best", False)):
        assert begun(scene, monkeypatch, absent, method, thorough).colmap_note == "COLMAP was not requested"
    assert begun(scene, monkeypatch, absent, "both").colmap_note == "COLMAP ran"
    with pytest.raises(BackendError, match="COLMAP ran"):
        begun(scene, monkeypatch, absent, "colmap")
    searched = search_axis(scene[1], 0.5, InitialisationOptions())
    for ratio, note in ((2.1, "COLMAP was not needed"), (1.9, "COLMAP ran")):
        second = replace(searched.best, cost=ratio * searched.best.cost)
        monkeypatch.setattr(
            initialisation, "search_axis", lambda *_, second=second: AxisSearchResult(searched.best, second)
        )
        assert begun(scene, monkeypatch, absent, "best").colmap_note == note
        assert Initialisation(searched.best, "direct", second, "").certain == (ratio > 2)


@pytest.mark.parametrize("axis", [AXIS, unit(0.05, 0.1, -1.0), unit(1, 0, 0)])
def test_the_search_finds_the_axis_from_nothing_but_the_rate(axis):
    truth = tracks_of(spin(axis), noise_px=0.3)
    obs, _ = observations(truth.tracks, CAMERA, 4)
    found = search_axis(obs, 0.5, InitialisationOptions())
    start = motion_from_axis(axis, truth.spin.center, 0.5)
    best = bundle_adjustment(start, linear_points(start, obs), obs, InitialisationOptions().cauchy_px, False)
    assert found.best.motion.rate_hz == 0.5
    assert found.best.cost == pytest.approx(best.cost, rel=0.02)
    assert found.second is None or found.second.cost >= found.best.cost
    assert found.second is None or angle_between(found.second.motion.axis, found.best.motion.axis) > 1.9


@pytest.mark.parametrize("count", [16, 100])
def test_directions_cover_the_sphere_evenly(count):
    axes = directions(count)
    np.testing.assert_allclose(np.linalg.norm(axes, axis=1), 1, rtol=1e-12)
    assert np.abs(axes.mean(axis=0)).max() < 0.05
    np.testing.assert_allclose(axes.T @ axes / count, np.eye(3) / 3, atol=0.03)
    between = np.degrees(np.arccos(np.clip(axes @ axes.T - 2 * np.eye(count), -1, 1))).min(axis=1)
    assert between.min() > 0.6 * np.degrees(np.sqrt(4 * np.pi / count))


def test_circle_and_slope_of_noisy_data():
    """RMS and deviations against those of the noise that was added; a single bad view moves no slope."""
    rng = np.random.default_rng(0)
    angle = np.linspace(0, 5, 4000)[:, None]
    points = np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), np.zeros(4000)])
    circle = fit_circle(points + rng.normal(0, 0.01, points.shape))
    assert circle.rms == pytest.approx(0.01 * np.sqrt(2), rel=0.05)  # radial and off the plane
    x = np.arange(11.0)
    y = 3 * x + 1
    y[4] += 100
    assert robust_slope(x, y) == pytest.approx(3)
    with pytest.raises(BackendError, match="one camera"):
        robust_slope(x[:1], y[:1])
    with pytest.raises(BackendError, match="2 camera"):
        fit_circle(points[:2])


def test_deviation_of_the_phase_slope_is_that_of_its_scatter():
    orbit = spin(AXIS).paper_orbit()
    seconds = np.linspace(0, 3, 60)
    rates, stated = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        poses = [orbit.world_to_camera(t) for t in seconds + rng.normal(0, 0.01, 60)]
        found = orbit_of_cameras(np.array([p[0] for p in poses]), np.array([p[1] for p in poses]), seconds)
        rates.append(found.motion.rate_hz)
        stated.append(found.rate_std_hz)
    # The median of slopes is noisier than least squares, by less than a half.
    assert 0.8 < np.std(rates) / np.mean(stated) < 1.7
    assert np.mean(rates) == pytest.approx(0.5, abs=4 * np.std(rates) / np.sqrt(60))
