"""The choice of tracks where there are more than can be used."""

import numpy as np
import pytest
from scenes import CAMERA, spin, tracks_of, unit

from esfo_backend.initialise.axis_search import search_axis
from esfo_backend.options import InitialisationOptions
from esfo_backend.orbit.observations import observations
from esfo_backend.orbit.selection import longest_points, spread
from esfo_core.orbit import angle_between


def random_tracks(count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.integers(0, 10**10, count), rng.integers(4, 100, count)


def test_few_tracks_are_all_kept():
    begin, rows = random_tracks(50)
    assert np.array_equal(spread(begin, rows, np.zeros(50, np.int64), 50), np.arange(50))


def test_every_part_of_the_time_gives_its_longest():
    begin, rows = random_tracks(1000)
    chosen = spread(begin, rows, np.zeros(1000, np.int64), 160)
    assert len(np.unique(chosen)) == 160
    part = np.minimum((begin - begin.min()) * 16 // (begin.max() - begin.min()), 15)
    for k in range(16):
        mine = np.flatnonzero(part == k)
        kept = np.intersect1d(mine, chosen)
        assert len(kept) == 10
        assert rows[kept].min() >= rows[np.setdiff1d(mine, kept)].max()


def test_lower_ranks_go_first():
    begin, rows = random_tracks(100)
    rank = np.arange(100) % 3
    chosen = spread(begin, rows, rank, 40)
    assert set(np.flatnonzero(rank == 0)) <= set(chosen)  # 34 of them
    assert (rank[chosen] == 1).sum() == 6


def test_within_the_limit_nothing_changes():
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)), noise_px=0.5)
    obs, _ = observations(scene.tracks, CAMERA, 4)
    assert longest_points(obs, obs.points) is obs


@pytest.mark.parametrize("outliers", [0.0, 0.3])
def test_a_search_with_few_tracks_ends_where_one_with_all_does(outliers):
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)), points=150, noise_px=0.5, outliers=outliers)
    obs, _ = observations(scene.tracks, CAMERA, 4)
    whole = search_axis(obs, 0.5, InitialisationOptions(search_tracks=obs.points))
    quick = search_axis(obs, 0.5, InitialisationOptions(search_tracks=100))
    assert obs.points > 400
    # False tracks have optima of their own; the comparison of starts calls 1 % the same.
    assert quick.best.cost == pytest.approx(whole.best.cost, rel=0.01 if outliers else 1e-6)
    assert angle_between(quick.best.motion.axis, whole.best.motion.axis) < 0.1
