"""What departs from one rotation is seen, what does not is left alone."""

import numpy as np
import pytest
from scenes import CAMERA, spin, tracks_of, unit

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution, bundle_adjustment, linear_points
from esfo_backend.adjustment.covariance import MotionCovariance
from esfo_backend.landmarks.landmarks import reobservable_points, reobserved_points
from esfo_backend.options import VerdictOptions
from esfo_backend.orbit.observations import ObservationRows, Observations, observations
from esfo_backend.orbit.parametrization import motion_from_axis
from esfo_backend.spin_rate.aperiodic import _ends, explain_aperiodic, translation_spread
from esfo_backend.verdict.rigidity import Rigidity, _axis_wander, rigidity, widened
from esfo_core.events import NS_PER_S
from esfo_core.orbit import angle_between, rotation
from esfo_core.tracks import Tracks

AXIS = unit(0.3, -0.8, 0.4)
LIMITS = VerdictOptions()


def measured(tracks, merge=None):
    obs, ids = observations(tracks, CAMERA, 4)
    if merge is not None:
        obs = obs.regroup(np.unique(merge[ids], return_inverse=True)[1].astype(np.int64))
    start = motion_from_axis(AXIS, np.array([0.1, 0.05, 4.0]), 0.5)
    return rigidity(bundle_adjustment(start, linear_points(start, obs), obs, 1.0, False), obs, 1.0, 0.25)


def moved(scene, shift_px_s=0.0, growth_s=0.0):
    """The tracks of a body that also moves across or towards the camera."""
    tracks = scene.tracks
    s = ((tracks.t - tracks.t.min()) / NS_PER_S)[:, None]
    middle = CAMERA.project(scene.spin.center[None])[0]
    uv = middle + (tracks.uv - middle) * (1 + growth_s * s) + [shift_px_s, 0] * s
    return Tracks(tracks.track_id, tracks.t, uv.astype(np.float32), tracks.sigma)


@pytest.mark.parametrize("seed", range(4))
def test_one_rotation_is_one(seed):
    scene = tracks_of(spin(AXIS), noise_px=0.5, seed=seed)
    found = measured(scene.tracks, scene.point_of_track)
    assert found.axis_wander_z < LIMITS.rigidity_z or found.axis_wander_deg < LIMITS.max_axis_wander_deg
    assert found.closure_error_z < LIMITS.rigidity_z or found.closure_error_px < LIMITS.max_closure_error_px


@pytest.mark.parametrize("true_hz", [0.4999, 0.5, 0.5002])
def test_tracks_that_are_observed_again_tell_the_rate(true_hz):
    """The orbit's rate is held at 0.5 Hz; a delay of more than the robust scale of 1 px would be read too small."""
    scene = tracks_of(spin(AXIS, true_hz), noise_px=0.3, points=120, duration_s=6.0)
    found = measured(scene.tracks).track_rate(0.5)
    assert abs(found.rate_hz - true_hz) < 4 * found.std_hz
    assert found.std_hz < 5e-5


def test_tracks_that_are_not_observed_again_tell_no_rate():
    scene = tracks_of(spin(AXIS), noise_px=0.3, duration_s=1.5)
    assert measured(scene.tracks).track_rate(0.5) is None


@pytest.mark.parametrize("change", [{"shift_px_s": 1.0}, {"growth_s": 0.01}])
def test_a_body_that_moves_on_misses_its_place(change):
    scene = tracks_of(spin(AXIS), noise_px=0.3, points=200)
    found = measured(moved(scene, **change))
    assert found.closure_error_z > LIMITS.rigidity_z
    assert found.closure_error_px > LIMITS.max_closure_error_px
    if "shift_px_s" in change:  # a turn takes two seconds
        assert found.closure_error_px == pytest.approx(2.0, rel=0.35)
    # The ball has a radius of 0.35 of its distance, so of at most 300 px in the image; most of it is nearer the middle.
    assert 1 / 300 < 2 * np.pi * found.closure_error_revolutions / found.closure_error_px < 3 / 300


def test_an_axis_that_turns_away_wanders():
    """Halfway the axis turns by 3 degrees about the direction of view."""
    first = tracks_of(spin(AXIS), noise_px=0.3, points=120)
    second = tracks_of(spin(rotation(unit(0, 0, 1), np.radians(3)) @ AXIS), noise_px=0.3, points=120)
    middle = int(np.median(first.tracks.t))
    a, b = first.tracks.select(first.tracks.t < middle), second.tracks.select(second.tracks.t >= middle)
    b = Tracks(b.track_id + np.uint32(10_000), b.t, b.uv, b.sigma)
    found = measured(Tracks.concatenate([a, b]))
    assert found.axis_wander_z > LIMITS.rigidity_z
    # Of two halves that differ by 3 degrees the standard deviation is 1.5; points that suit both take some of it.
    assert 0.3 < found.axis_wander_deg < 2.0


def test_too_little_data_says_nothing():
    scene = tracks_of(spin(AXIS), noise_px=0.3, points=8)
    found = measured(scene.tracks)
    assert found.axis_wander_z == 0.0


def test_deviations_are_widened_by_what_was_measured():
    cov = MotionCovariance(3e-3, np.diag([1e-4, 4e-4]))
    same = widened(cov, Rigidity(1.0, 3.9, 1.0, 3.9, 2e-3), 2.0, 0.04, 4.0)
    assert same.rate_std_hz == pytest.approx(3e-3)
    np.testing.assert_allclose(same.axis_cov, cov.axis_cov)
    wide = widened(cov, Rigidity(np.degrees(0.03), 9.0, 2.0, 9.0, 2e-3), 2.0, 0.02, 4.0)
    assert wide.rate_std_hz == pytest.approx(5e-3)  # of 3e-3 and 2 Hz times 2e-3 turns
    np.testing.assert_allclose(wide.axis_cov, cov.axis_cov + 0.0025 * np.eye(2))


def test_widened_deviations_cover_what_a_slow_slide_does():
    """Slides of 0.3 to 1 px per second in any direction, small enough for points to be recognised turn after turn."""
    z_rate, z_axis = [], []
    rng = np.random.default_rng(0)
    for seed in range(8):
        scene = tracks_of(spin(AXIS), noise_px=0.3, points=150, seed=seed)
        angle, speed = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 1.0)
        s = ((scene.tracks.t - scene.tracks.t.min()) / NS_PER_S)[:, None]
        uv = scene.tracks.uv + speed * s * [np.cos(angle), np.sin(angle)]
        tracks = Tracks(scene.tracks.track_id, scene.tracks.t, uv.astype(np.float32), scene.tracks.sigma)
        obs, ids = observations(tracks, CAMERA, 4)
        obs = obs.regroup(np.unique(scene.point_of_track[ids], return_inverse=True)[1].astype(np.int64))
        start = motion_from_axis(AXIS, scene.spin.center, 0.5)
        solution = bundle_adjustment(start, linear_points(start, obs), obs, 1.0)
        found = rigidity(solution, obs, 1.0, 0.25)
        nothing = MotionCovariance(0.0, np.zeros((2, 2)))
        wide = widened(nothing, found, solution.motion.rate_hz, 2.0 / (2 * 800.0), LIMITS.rigidity_z)
        z_rate.append(abs(solution.motion.rate_hz - 0.5) / wide.rate_std_hz)
        z_axis.append(np.radians(angle_between(solution.motion.axis, AXIS)) / np.sqrt(wide.axis_cov[0, 0]))
    assert max(z_rate) < 3
    assert max(z_axis) < 3.5


def test_points_that_could_be_seen_again():
    scene = tracks_of(spin(AXIS), duration_s=3.0, points=120)  # one turn and a half
    obs, ids = observations(scene.tracks, CAMERA, 4)
    truth = scene.point_of_track[ids]
    begin, end = obs.rows.dt.min(), obs.rows.dt.max()
    rows = np.split(obs.rows.dt, obs.rows.first[1:-1])
    expected = sum(any(dt + 2.0 <= end or dt - 2.0 >= begin for dt in row) for row in rows)
    assert reobservable_points(obs, 0.5) == expected < obs.points
    merged = obs.regroup(np.unique(truth, return_inverse=True)[1].astype(np.int64))
    assert reobserved_points(merged, 0.5) <= reobservable_points(merged, 0.5)
    assert reobservable_points(obs, 2.0) == obs.points
    assert reobservable_points(obs, 0.1) == 0


def test_points_seen_again():
    """A point returns after it was hidden for half a turn, or is never hidden for a whole turn."""
    times = [[0.0, 0.1, 1.2], [0.0, 0.5, 1.1, 1.6, 2.1], [0.0, 0.9, 1.8], [1.0, 1.5, 1.9]]
    dt = np.concatenate(times)
    first = np.concatenate([[0], np.cumsum([len(t) for t in times])])
    rows = ObservationRows(dt, np.zeros((len(dt), 2)), np.ones(len(dt)), first, np.array([800.0, 800.0]))
    assert [reobserved_points(Observations(rows, 0), rate) for rate in (0.5, 0.55, 1.0)] == [2, 2, 4]


def straight(count, velocity_px_s, duration_s=2.0, seed=0):
    """Tracks of a body that is only displaced, each seen all the time."""
    rng = np.random.default_rng(seed)
    s = np.arange(0, duration_s, 0.05)
    start = rng.uniform(200, 300, (count, 1, 2))
    uv = start + np.array(velocity_px_s) * s[:, None] * rng.uniform(0.97, 1.03, (count, 1, 1))
    t = np.tile((1e9 + s * 1e9).astype(np.int64), count)
    ids = np.repeat(np.arange(count), len(s))
    return Tracks.from_columns(ids, t, uv.reshape(-1, 2) + rng.normal(0, 0.2, (len(ids), 2)), np.full(len(ids), 0.3))


def test_why_there_is_no_period():
    still = explain_aperiodic(straight(40, (0.0, 0.0)), 2.0, 10, 800.0)
    nothing = explain_aperiodic(Tracks.empty(), 2.0, 10, 800.0)
    slides = explain_aperiodic(straight(40, (30.0, 10.0)), 2.0, 10, 800.0)
    part = explain_aperiodic(tracks_of(spin(AXIS), duration_s=0.8).tracks, 0.8, 10, 800.0)
    much = explain_aperiodic(tracks_of(spin(AXIS), duration_s=8.0).tracks, 8.0, 10, 800.0)
    assert (still.flag, nothing.flag, slides.flag) == ("too_few_tracks", "too_few_tracks", "not_a_rotation")
    assert "translation" in slides.reason
    assert "0 tracks move" in still.reason
    assert (part.flag, much.flag) == ("too_few_turns", "no_repetition")


@pytest.mark.parametrize("velocity", [(0.1, 0.05, -0.4), (0.0, 0.1, 0.6), (0.0, 0.0, -0.3), (0.3, 0.0, 0.0)])
def test_a_translation_in_any_direction_is_one(velocity):
    """A body 2 units away and 0.3 deep that slides across, away or nearer, by up to six tenths of its distance."""
    tracks = translating(np.array(velocity), depth=0.3)
    found = explain_aperiodic(tracks, 2.0, 10, 800.0)
    assert found.flag == "not_a_rotation"
    assert "translation" in found.reason
    assert translation_spread(_ends(translating(np.array(velocity), depth=0.0, noise_px=0.0))) < 1e-3


@pytest.mark.parametrize("turns", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("axis", [AXIS, unit(0, 1, 0), unit(0.1, 0.05, 4.0)])
def test_part_of_a_turn_is_no_translation(axis, turns):
    scene = tracks_of(spin(axis), duration_s=2 * turns, noise_px=0.3)
    assert translation_spread(_ends(scene.tracks)) > 0.2
    assert explain_aperiodic(scene.tracks, 2 * turns, 10, 800.0).flag == "too_few_turns"


def translating(velocity, depth, noise_px=0.2, count=40, seed=1):
    rng = np.random.default_rng(seed)
    s = np.arange(0, 2.0, 0.05)
    X = np.array([0.0, 0.0, 2.0]) + rng.uniform(-0.5, 0.5, (count, 1, 3)) * [0.6, 0.5, depth] + velocity * s[:, None]
    uv = CAMERA.project(X.reshape(-1, 3)) + rng.normal(0, noise_px, (count * len(s), 2))
    t = np.tile((1e9 + s * 1e9).astype(np.int64), count)
    return Tracks.from_columns(np.repeat(np.arange(count), len(s)), t, uv, np.full(len(uv), 0.3))


@pytest.mark.parametrize("true_deg", [0.0, 0.5])
def test_wander_of_segments_with_known_deviations_is_unbiased(true_deg, monkeypatch):
    """Of segments whose orientations differ by exactly known distributions, nothing but their statistics counts."""
    rng = np.random.default_rng(0)
    std = np.radians([0.3, 0.4, 0.5])

    def segment(*_):
        return rng.normal(0.0, np.hypot(std, np.radians(true_deg))), np.diag(std**2)

    monkeypatch.setattr("esfo_backend.verdict.rigidity._segment", segment)
    scene = tracks_of(spin(AXIS), points=20)
    obs, _ = observations(scene.tracks, CAMERA, 4)
    start = motion_from_axis(AXIS, scene.spin.center, 0.5)
    solution = OrbitSolution(start, linear_points(start, obs), 0.0, 0)
    found = np.array([_axis_wander(solution, obs, 1.0, 0.0) for _ in range(1500)])
    if true_deg:  # six segments; what is cut off below zero is little
        assert np.mean(found[:, 0] ** 2) == pytest.approx(true_deg**2, rel=0.06)
    else:  # a normal variable of which the part below zero is cut off
        assert np.mean(found[:, 1] > 0) == pytest.approx(0.5, abs=0.05)
        assert np.mean(found[:, 1] > 1.645) == pytest.approx(0.05, abs=0.02)
