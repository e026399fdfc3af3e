"""Live estimates that go on from the last one: sharper turn by turn, in bounded work."""

import numpy as np
import pytest
from scenes import CAMERA, spin, tracks_of, unit

from esfo_backend.adjustment.bundle_adjustment import bundle_adjustment, linear_points
from esfo_backend.adjustment.covariance import schur_marginal
from esfo_backend.adjustment.factor_graph import optimise_graph
from esfo_backend.errors import BackendError
from esfo_backend.online.incremental import IncrementalSolver, thinned
from esfo_backend.options import BackendOptions, LiveEstimateOptions
from esfo_backend.orbit.observations import observations
from esfo_backend.orbit.parametrization import motion_from_axis
from esfo_core.orbit import angle_between
from esfo_core.tracks import Tracks

AXIS = unit(0.3, -0.8, 0.4)
TURN_NS = 2_000_000_000
STEP_NS = 100_000_000


def between(tracks, begin, end):
    return tracks.select((tracks.t >= begin) & (tracks.t < end))


def started(scene, turns=1.5, options=None):
    """IncrementalSolver that starts from the true motion and one point per track."""
    options = options or BackendOptions()
    first = between(scene.tracks, 0, scene.spin.t0 + int(turns * TURN_NS))
    incremental = IncrementalSolver(CAMERA, options)
    ids = np.unique(first.track_id)
    incremental.begin(
        first, motion_from_axis(scene.spin.axis, scene.spin.center, 0.5), ids, np.arange(len(ids)), CAMERA
    )
    return incremental


def followed(incremental, scene, begin, turns):
    """Feed the rest in steps of 0.1 s; yield landmarks, marginal and time."""
    start = scene.spin.t0 + int(begin * TURN_NS)
    for t in range(start, scene.spin.t0 + int(turns * TURN_NS), STEP_NS):
        yield *incremental.update(between(scene.tracks, t, t + STEP_NS)), t


def test_estimates_sharpen_turn_by_turn_with_bounded_work():
    options = BackendOptions(live=LiveEstimateOptions(max_tracks=200))
    errors, stds = {2: [], 4: [], 8: []}, {2: [], 4: [], 8: []}
    for seed in range(4):
        scene = tracks_of(spin(AXIS), points=80, noise_px=0.5, outliers=0.2, duration_s=17.0, seed=seed)
        incremental = started(scene, options=options)
        for landmarks, result, t in followed(incremental, scene, 1.5, 8.3):
            # What an update costs is decided by these two numbers alone.
            assert len(landmarks.label) <= 200
            assert len(landmarks.obs.rows.dt) <= 200 * 32
            turns = (t + STEP_NS - scene.spin.t0) / TURN_NS
            for k, found in errors.items():
                if abs(turns - k) < 0.25:
                    found.append(landmarks.solution.motion.rate_hz / 0.5 - 1)
                    stds[k].append(2 * np.sqrt(result.marginal[3, 3]))
    rms = {k: np.sqrt(np.mean(np.square(v))) for k, v in errors.items()}
    # With points that recur the rate is known to (position error / time): four times as long is at least two times
    # as good, whatever the number of rows.
    assert rms[8] < rms[2] / 2, rms
    assert np.mean(stds[8]) < np.mean(stds[4]) < np.mean(stds[2])
    assert rms[8] < 1e-4


def test_points_are_known_again():
    scene = tracks_of(spin(AXIS), points=60, noise_px=0.5, duration_s=8.0)
    incremental = started(scene)
    landmarks = [s for s, _, _ in followed(incremental, scene, 1.5, 4.0)][-1]
    # 60 points are there; one point per track, or per pair of them, would be several times as many.
    assert landmarks.obs.points < 1.5 * 60 < len(incremental.ids) / 2
    assert len(incremental.reobserved) > 0.7 * len(np.unique(scene.tracks.track_id))
    truth = scene.point_of_track[incremental.ids]
    pairs = [(truth[incremental.label == j]) for j in np.unique(incremental.label)]
    wrong = sum(len(np.unique(p)) > 1 for p in pairs)
    assert wrong <= 0.02 * len(pairs)
    assert angle_between(landmarks.solution.motion.axis, AXIS) < 0.1


def test_another_motion_is_an_error():
    scene, other = (
        tracks_of(spin(AXIS), noise_px=0.5),
        tracks_of(spin(unit(1, 0, 0.2), 0.9), noise_px=0.5, outliers=1.0),
    )
    incremental = started(scene)
    incremental._tracks = Tracks.empty()
    with pytest.raises(BackendError, match="follow one rotation"):
        incremental.update(other.tracks)
    with pytest.raises(BackendError, match="no search has found a motion"):
        IncrementalSolver(CAMERA, BackendOptions()).update(scene.tracks)


def test_marginal_is_that_of_the_graph():
    scene = tracks_of(spin(AXIS), noise_px=0.3, points=30)
    obs, _ = observations(scene.tracks, CAMERA, 4)
    motion = motion_from_axis(AXIS, scene.spin.center, 0.5)
    result = optimise_graph(bundle_adjustment(motion, linear_points(motion, obs), obs, 1.0), obs, 1.0, 5)
    mine = schur_marginal(result.solution, obs, 1.0)
    np.testing.assert_allclose(mine, result.marginal, rtol=1e-5, atol=1e-9 * np.abs(result.marginal).max())


def test_thinning_keeps_ends_and_short_tracks():
    rng = np.random.default_rng(0)
    lengths = np.array([1, 2, 31, 32, 33, 64, 100, 1000])
    ids = np.repeat(np.arange(8), lengths)
    t = np.concatenate([np.sort(rng.choice(10**6, n, replace=False)) for n in lengths])
    shuffled = rng.permutation(len(ids))
    tracks = Tracks.from_columns(ids, t, np.zeros((len(ids), 2)), np.ones(len(ids))).select(shuffled)
    thin = thinned(tracks, 32)
    for j, n in enumerate(lengths):
        every, kept = np.sort(t[ids == j]), thin.t[thin.track_id == j]
        assert len(kept) == min(n, 32)
        assert np.isin(kept, every).all()
        assert (kept[0], kept[-1]) == (every[0], every[-1])
        steps = np.diff(np.searchsorted(every, kept), prepend=-1)[1:]
        assert n == 1 or np.ptp(steps) <= 1


def test_the_latest_tracks_take_part_before_older_ones():
    scene = tracks_of(spin(AXIS), points=80, duration_s=8.0)
    solver = started(scene, 4.0, BackendOptions(live=LiveEstimateOptions(max_tracks=40)))
    first = {i: t for i, t in zip(scene.tracks.track_id[::-1], scene.tracks.t[::-1], strict=True)}
    latest = sorted(first, key=lambda i: first[i])[-20:]
    assert len(first) > 200
    assert set(latest) <= set(solver.tracks.track_id)
