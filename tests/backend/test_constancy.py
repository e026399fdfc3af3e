"""What departs from one rotation is seen, what does not is left alone."""

import numpy as np
import pytest
from scenes import CAMERA, spin, tracks_of, unit

from esfo_backend.adjust import adjust, linear_points
from esfo_backend.constancy import constancy
from esfo_backend.no_period import why_no_period
from esfo_backend.options import VerdictOptions
from esfo_backend.problem import motion_from_axis, observations
from esfo_core.orbit import NANOSECONDS, rotation
from esfo_core.tracks import Tracks

AXIS = unit(0.3, -0.8, 0.4)
LIMITS = VerdictOptions()


def measured(tracks, merge=None):
    obs, ids = observations(tracks, CAMERA, 4)
    if merge is not None:
        obs = obs.regroup(np.unique(merge[ids], return_inverse=True)[1].astype(np.int64))
    start = motion_from_axis(AXIS, np.array([0.1, 0.05, 4.0]), 0.5)
    return constancy(adjust(start, linear_points(start, obs), obs, 1.0, False), obs, 1.0, 0.25)


def moved(scene, shift_px_s=0.0, growth_s=0.0):
    """The tracks of a body that also moves across or towards the camera."""
    tracks = scene.tracks
    s = ((tracks.t - tracks.t.min()) / NANOSECONDS)[:, None]
    middle = CAMERA.project(scene.spin.center[None])[0]
    uv = middle + (tracks.uv - middle) * (1 + growth_s * s) + [shift_px_s, 0] * s
    return Tracks(tracks.track_id, tracks.t, uv.astype(np.float32), tracks.sigma)


@pytest.mark.parametrize("seed", range(4))
def test_one_rotation_is_one(seed):
    scene = tracks_of(spin(AXIS), noise_px=0.5, seed=seed)
    found = measured(scene.tracks, scene.point_of_track)
    assert found.wander_z < LIMITS.constancy_z or found.wander_deg < LIMITS.max_wander_deg
    assert found.missed_z < LIMITS.constancy_z or found.missed_px < LIMITS.max_missed_px


@pytest.mark.parametrize("change", [{"shift_px_s": 1.0}, {"growth_s": 0.01}])
def test_a_body_that_moves_on_misses_its_place(change):
    scene = tracks_of(spin(AXIS), noise_px=0.3, points=200)
    found = measured(moved(scene, **change))
    assert found.missed_z > LIMITS.constancy_z
    assert found.missed_px > LIMITS.max_missed_px
    if "shift_px_s" in change:  # a turn takes two seconds
        assert found.missed_px == pytest.approx(2.0, rel=0.35)


def test_an_axis_that_turns_away_wanders():
    """Halfway the axis turns by 3 degrees about the direction of view."""
    first = tracks_of(spin(AXIS), noise_px=0.3, points=120)
    second = tracks_of(spin(rotation(unit(0, 0, 1), np.radians(3)) @ AXIS), noise_px=0.3, points=120)
    middle = int(np.median(first.tracks.t))
    a, b = first.tracks.select(first.tracks.t < middle), second.tracks.select(second.tracks.t >= middle)
    b = Tracks(b.track_id + np.uint32(10_000), b.t, b.uv, b.sigma)
    found = measured(Tracks.concatenate([a, b]))
    assert found.wander_z > LIMITS.constancy_z
    # Of two halves that differ by 3 degrees the standard deviation is 1.5; points that suit both take some of it.
    assert 0.3 < found.wander_deg < 2.0


def test_too_little_data_says_nothing():
    scene = tracks_of(spin(AXIS), noise_px=0.3, points=8)
    found = measured(scene.tracks)
    assert found.wander_z == 0.0


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
    still = why_no_period(straight(40, (0.0, 0.0)), 2.0, 10)
    nothing = why_no_period(Tracks.empty(), 2.0, 10)
    slides = why_no_period(straight(40, (30.0, 10.0)), 2.0, 10)
    part = why_no_period(tracks_of(spin(AXIS), duration_s=0.8).tracks, 0.8, 10)
    much = why_no_period(tracks_of(spin(AXIS), duration_s=8.0).tracks, 8.0, 10)
    assert (still.flag, nothing.flag, slides.flag) == ("not_a_rotation",) * 3
    assert "translation" in slides.reason
    assert "0 tracks move" in still.reason
    assert (part.flag, much.flag) == ("too_few_turns", "not_a_rotation")
