"""Deviations of tracks that share errors at the same time, and the pairs that they are made of, counted one by one."""

import numpy as np
from scenes import CAMERA, spin, tracks_of, unit

from esfo_backend.adjustment import covariance as covariance_module
from esfo_backend.adjustment.bundle_adjustment import bundle_adjustment, linear_points
from esfo_backend.adjustment.common_errors import Timeline, _over_time, _within_landmarks, common_variance
from esfo_backend.adjustment.covariance import motion_covariance, schur_marginal
from esfo_backend.orbit.observations import observations
from esfo_backend.orbit.parametrization import motion_from_axis
from esfo_core.orbit import NS_PER_S
from esfo_core.tracks import Tracks

AXIS = unit(0.3, -0.8, 0.4)
SEEDS = 30


def trembling(scene, size_px, rng):
    """The tracks, seen by a camera that trembles at all frequencies below about three times a turn's twenty."""
    t = (scene.tracks.t - scene.tracks.t.min()) / NS_PER_S
    step, memory_s = 0.005, 0.1
    keep = np.exp(-step / memory_s)
    walk = np.zeros((int(t.max() / step) + 2, 2))
    for k in range(1, len(walk)):
        walk[k] = keep * walk[k - 1] + size_px * np.sqrt(1 - keep**2) * rng.normal(size=2)
    shift = np.stack([np.interp(t, step * np.arange(len(walk)), w) for w in walk.T], axis=1)
    uv = (scene.tracks.uv + shift).astype(np.float32)
    return Tracks(scene.tracks.track_id, scene.tracks.t, uv, scene.tracks.sigma)


def rate_and_deviation(seed, size_px):
    scene = tracks_of(spin(AXIS), noise_px=0.3, points=60, duration_s=5.0, seed=seed)
    tracks = trembling(scene, size_px, np.random.default_rng(seed)) if size_px else scene.tracks
    obs, ids = observations(tracks, CAMERA, 4)
    obs = obs.regroup(np.unique(scene.point_of_track[ids], return_inverse=True)[1].astype(np.int64))
    start = motion_from_axis(AXIS, scene.spin.center, 0.5)
    solution = bundle_adjustment(start, linear_points(start, obs), obs, 1.0)
    covariance = motion_covariance(solution, obs, schur_marginal(solution, obs, 1.0), 1.0)
    return solution.motion.rate_hz - 0.5, covariance.rate_std_hz


def rms_pull(found):
    return float(np.sqrt(np.mean([(error / std) ** 2 for error, std in found])))


def test_deviations_hold_while_the_camera_trembles(monkeypatch):
    """Half a pixel that all landmarks share: errors are four times what independent landmarks would let expect."""
    aware = [rate_and_deviation(seed, 0.5) for seed in range(SEEDS)]
    monkeypatch.setattr(covariance_module, "common_variance", lambda influence, *_: np.zeros(influence.shape[1]))
    unaware = [rate_and_deviation(seed, 0.5) for seed in range(SEEDS)]
    assert rms_pull(unaware) > 3.5
    assert 0.6 < rms_pull(aware) < 1.6


def test_deviations_of_independent_landmarks_stay(monkeypatch):
    aware = [rate_and_deviation(seed, 0.0) for seed in range(SEEDS)]
    monkeypatch.setattr(covariance_module, "common_variance", lambda influence, *_: np.zeros(influence.shape[1]))
    unaware = [rate_and_deviation(seed, 0.0) for seed in range(SEEDS)]
    ratio = np.array([a[1] / u[1] for a, u in zip(aware, unaware, strict=True)])
    assert ratio.min() >= 1.0
    assert np.mean(ratio) < 1.15
    assert 0.7 < rms_pull(aware) < 1.3


def some_rows(count=5, each=12):
    rng = np.random.default_rng(3)
    dt = np.sort(rng.uniform(-2, 2, (count, each)), axis=1).ravel()
    first = np.arange(count + 1) * each
    return Timeline(dt, first, 1.0), rng.normal(size=(60, 3))


def test_sums_over_pairs_are_those_of_every_pair():
    rows, influence = some_rows()
    bins = np.floor((rows.dt - rows.dt.min()) / 0.1).astype(np.int64)
    landmark = np.repeat(np.arange(5), 12)
    every, own = np.zeros(3), np.zeros(3)
    for k in range(60):
        for m in range(60):
            weight = max(0.0, 1 - abs(bins[k] - bins[m]) / 4)
            every += weight * influence[k] * influence[m]
            own += weight * influence[k] * influence[m] * (landmark[k] == landmark[m])
    np.testing.assert_allclose(_over_time(influence, bins, int(bins.max()) + 1), every)
    np.testing.assert_allclose(_within_landmarks(influence, bins, rows.first, 4), own)


def test_time_has_no_unit():
    """The same rows 1024 times slower have the same variance."""
    rows, influence = some_rows()
    fast = common_variance(influence, rows)
    np.testing.assert_allclose(common_variance(influence, Timeline(1024 * rows.dt, rows.first, 1 / 1024)), fast)
    assert (fast >= 0).all()
