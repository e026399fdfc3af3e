"""Tracks against the point that they have under the true poses: exact ones, noisy ones and wrong ones."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from esfo_core.camera import Camera
from esfo_core.evaluation.track_error import fit_tracks
from esfo_core.orbit import Spin, rotation
from esfo_core.tracks import Tracks
from esfo_simulation.tracks import SyntheticTrackOptions, synthetic_tracks

CAMERA = Camera.pinhole(640, 480, 800.0)
SPIN = Spin(np.array([0.36, -0.8, 0.48]), 0.5, np.array([0.1, 0.05, 4.0]), 1_000_000_000)


def poses(t):
    R = np.array([rotation(SPIN.axis, 2 * np.pi * SPIN.rate_hz * (v - SPIN.t0) / 1e9) for v in t]).reshape(-1, 3, 3)
    return R, np.tile(SPIN.center, (len(t), 1))


def tracked(**options):
    return synthetic_tracks(SPIN, CAMERA, SyntheticTrackOptions(track_s=0.6, **options))


def test_exact_tracks_fit_exactly():
    fitted = fit_tracks(tracked().tracks, CAMERA, poses)
    assert len(fitted.count) > 50
    assert fitted.error.max() < 1e-3  # float32 pixels
    assert fitted.good.all()
    assert fitted.age == pytest.approx((fitted.count - 1) * 0.03, abs=1e-6)


def test_the_point_is_that_of_least_squares():
    """Against scipy, which knows nothing of the linear start and the steps."""
    fitted = fit_tracks(tracked(noise_px=0.5).tracks, CAMERA, poses)
    R, T = poses(fitted.tracks.t)
    for k in range(0, len(fitted.count), 10):
        rows = fitted.index == k

        def residual(X, rows=rows):
            return (CAMERA.project(R[rows] @ X + T[rows]) - fitted.tracks.uv[rows]).ravel()

        best = least_squares(residual, np.zeros(3), xtol=1e-12, ftol=1e-12)
        assert fitted.rms[k] == pytest.approx(np.sqrt(2 * best.cost / rows.sum()), rel=1e-4)
    # Two coordinates of 0.5 px; the point takes three of them.
    assert fitted.pull(fitted.good) == pytest.approx(1.0, abs=0.05)


def test_what_follows_no_point_is_not_good():
    scene = tracked(noise_px=0.3, outliers=0.3)
    fitted = fit_tracks(scene.tracks, CAMERA, poses)
    outlier = scene.point_of_track[fitted.tracks.track_id[np.flatnonzero(np.diff(fitted.index, prepend=-1))]] < 0
    assert fitted.good[~outlier].mean() > 0.99
    assert np.median(fitted.rms[outlier]) > 3 * np.median(fitted.rms[~outlier])


def test_short_tracks_and_none_are_not_judged():
    scene = tracked()
    few = scene.tracks.select(np.isin(np.arange(len(scene.tracks)) % 20, (0, 1, 2)))
    _, count = np.unique(few.track_id, return_counts=True)
    assert len(fit_tracks(few, CAMERA, poses).count) == (count >= 4).sum()
    assert len(fit_tracks(Tracks.empty(), CAMERA, poses).count) == 0
