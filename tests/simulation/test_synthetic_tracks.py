"""Synthetic tracks and activity against the truth that comes with them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.errors import SimulationError
from esfo_core.orbit import Spin
from esfo_simulation.activity import synthetic_activity
from esfo_simulation.tracks import SyntheticTrackOptions, synthetic_tracks

T0 = 1_700_000_000_123_456_789
CAMERA = Camera(
    640, 480, np.array([[800.0, 0, 320], [0, 790, 235], [0, 0, 1]]), "plumb_bob", np.array([-0.2, 0.05, 0, 0])
)
DIAGONAL = Spin(np.array([0.48, 0.6, 0.64]), 0.5, np.array([0.1, 0.05, 4.0]), T0)
UPRIGHT = Spin(np.array([0, 1.0, 0]), 0.5, np.array([0, 0, 4.0]), T0)
FLOAT32_PX = 640 * 2.0**-24  # half the spacing of float32 at the far edge of the image


def scene(spin=DIAGONAL, **options):
    return synthetic_tracks(spin, CAMERA, SyntheticTrackOptions(**options))


def true_uv(found):
    """Pixels (N, 2) where the true point of each row is, NaN for outliers; worked out without `Spin.transform`."""
    spin, tracks = found.spin, found.tracks
    points = np.concatenate([found.points, np.full((1, 3), np.nan)])[found.point_of_track[tracks.track_id]]
    angle = 2 * np.pi * spin.rate_hz * ((tracks.t - spin.t0) * 1e-9)
    return CAMERA.project(Rotation.from_rotvec(angle[:, None] * spin.axis).apply(points) + spin.center)


def durations(tracks):
    return np.array([np.ptp(tracks.t[tracks.track_id == i]) for i in np.unique(tracks.track_id)]) * 1e-9


@pytest.mark.parametrize("spin", [DIAGONAL, UPRIGHT, Spin(UPRIGHT.axis, 7.0, UPRIGHT.center, 0)])
def test_rows_without_noise_are_the_images_of_their_points(spin):
    found = scene(spin)
    assert len(found.tracks) > 500
    np.testing.assert_allclose(found.tracks.uv, true_uv(found), atol=FLOAT32_PX + 1e-6, rtol=0)
    radius = 0.35 * np.linalg.norm(spin.center)
    np.testing.assert_allclose(np.linalg.norm(found.points, axis=1), radius)


def test_noise_has_the_deviation_that_sigma_states():
    found = scene(noise_px=0.5, points=200)
    errors = found.tracks.uv - true_uv(found)
    n = errors.size
    assert n > 5000
    # four standard deviations of the estimates of a standard deviation, a mean and a largest of n normal draws
    assert abs(errors.std() - 0.5) < 4 * 0.5 / np.sqrt(2 * n)
    assert abs(errors.mean()) < 4 * 0.5 / np.sqrt(n)
    assert np.abs(errors).max() < 0.5 * 6
    assert (found.tracks.sigma == np.float32(0.5)).all()
    assert (scene().tracks.sigma == np.float32(1e-3)).all()


def test_outliers_are_as_many_as_asked_for_and_drift_straight_away():
    found = scene(outliers=0.3, points=200)
    wrong = found.point_of_track < 0
    assert abs(wrong.mean() - 0.3) < 4 * np.sqrt(0.3 * 0.7 / len(wrong))
    outlier_row = wrong[found.tracks.track_id]
    errors = np.linalg.norm(found.tracks.uv - true_uv(found), axis=1)
    assert np.isnan(errors[outlier_row]).all()
    assert errors[~outlier_row].max() < FLOAT32_PX * np.sqrt(2) + 1e-6
    for i in np.flatnonzero(wrong)[:20]:
        uv = found.tracks.uv[found.tracks.track_id == i].astype(float)
        steps = np.diff(uv, axis=0)
        np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), atol=4 * FLOAT32_PX)
        assert np.linalg.norm(steps[0]) >= 0.5
    assert (scene(outliers=1.0).point_of_track == -1).all()


@pytest.mark.parametrize("track_s", [0.03, 0.05, 0.1, 0.31, 5.0])
def test_no_track_is_longer_than_asked_for(track_s):
    found = scene(track_s=track_s, duration_s=2.0)
    lengths = durations(found.tracks)
    assert lengths.max() <= track_s + 1e-9
    assert lengths.min() > 0
    assert lengths.max() > min(track_s - 2 * 0.03, 0.3)


def test_rows_of_a_track_follow_one_another_by_the_window():
    found = scene()
    tracks = found.tracks
    assert found.point_of_track.shape == (len(np.unique(tracks.track_id)),)
    same = np.diff(tracks.track_id.astype(int)) == 0
    assert (np.diff(tracks.t)[same] == 30_000_000).all()
    assert tracks.t.min() >= T0
    assert tracks.t.max() < T0 + 4 * 10**9
    assert ((tracks.t - T0) % 30_000_000 == 0).all()


def test_a_point_comes_back_as_another_track():
    found = scene()
    assert np.bincount(found.point_of_track).max() >= 4


def test_only_points_on_the_near_side_within_the_image_are_seen():
    found = scene()
    tracks = found.tracks
    assert ((tracks.uv >= 0) & (tracks.uv <= [639, 479])).all()
    turn = Rotation.from_rotvec(np.pi * ((tracks.t - T0) * 1e-9)[:, None] * DIAGONAL.axis)
    outward = turn.apply(found.points[found.point_of_track[tracks.track_id]])
    assert (np.einsum("ij,ij->i", outward, outward + DIAGONAL.center) < 0).all()


def test_the_seed_decides_everything():
    a, b, c = scene(seed=1, noise_px=0.3, outliers=0.2), scene(seed=1, noise_px=0.3, outliers=0.2), scene(seed=2)
    assert a.points.tobytes() == b.points.tobytes()
    assert a.point_of_track.tobytes() == b.point_of_track.tobytes()
    for name in ("track_id", "t", "uv", "sigma"):
        assert getattr(a.tracks, name).tobytes() == getattr(b.tracks, name).tobytes()
    assert a.points.tobytes() != c.points.tobytes()


def test_impossible_scenes_are_errors():
    behind = Spin(UPRIGHT.axis, 0.5, -UPRIGHT.center, T0)
    with pytest.raises(SimulationError, match="none of 60 points is seen by the 640x480 camera"):
        scene(behind)
    with pytest.raises(SimulationError, match=r"tracks of 0\.02 s are shorter than the 0\.03 s between rows"):
        scene(track_s=0.02)


def activity(seed=0, spin=UPRIGHT, points=None):
    points = scene(spin).points if points is None else points
    return synthetic_activity(spin, points, CAMERA, 4.0, seed=seed)


def test_activity_has_the_form_that_it_states():
    found = activity()
    assert (found.t0, found.bin, found.cell, found.end) == (T0, 5_000_000, 32, T0 + 4 * 10**9)
    assert found.counts.shape == (800, 2, 15, 20)
    assert (found.counts == activity().counts).all()
    assert (found.counts != activity(seed=1).counts).any()


def test_activity_repeats_with_the_turn_and_not_with_half_of_it():
    counts = np.sqrt(activity().counts.astype(float)).reshape(800, -1)
    counts -= counts.mean(axis=0)

    def correlation(lag):
        a, b = counts[1 : 800 - lag], counts[1 + lag :]
        return (a * b).sum() / np.sqrt((a * a).sum() * (b * b).sum())

    turn = 400  # bins of 5 ms in a turn of 2 s
    assert correlation(turn) == max(correlation(lag) for lag in range(40, 500, 20))
    assert correlation(turn) > 2 * correlation(turn // 2)


def test_activity_comes_from_where_the_point_is_and_tells_how_far_it_went():
    point = np.array([[0, 0.3, -0.8]])  # on the near side, and for a fifth of a turn after; its height stays 0.3
    counts = activity(points=point).counts[:80].sum(axis=(1, 3), dtype=int)  # the first 0.4 s, per row of cells
    row = int(CAMERA.project(point + UPRIGHT.center)[0, 1] // 32)
    noise = 2 * 0.05 * 20  # expected events of a row of cells in a bin
    elsewhere = np.delete(counts, [row - 1, row, row + 1], axis=1)
    assert elsewhere.mean() == pytest.approx(noise, abs=4 * np.sqrt(noise / elsewhere.size))
    angles = np.linspace(0, np.pi * 0.4, 1000)[:, None] * UPRIGHT.axis
    path = CAMERA.project(Rotation.from_rotvec(angles).apply(point[0]) + UPRIGHT.center)
    expected = 4 * np.linalg.norm(np.diff(path, axis=0), axis=1).sum() + 3 * 80 * noise
    assert counts[:, row - 1 : row + 2].sum() == pytest.approx(expected, abs=4 * np.sqrt(expected))


def test_activity_without_points_is_noise():
    counts = activity(points=np.empty((0, 3))).counts
    assert isinstance(activity(points=np.empty((0, 3))), Activity)
    # a Poisson mean of 0.05 over n draws is known to sqrt(0.05 / n)
    assert counts.mean() == pytest.approx(0.05, abs=4 * np.sqrt(0.05 / counts.size))
