"""Window means against a loop, and their standard deviation against the truth."""

import numpy as np
import pytest

from esfo_core.events import make_events
from esfo_frontend.clustering.cluster_joiner import JoinedCorners
from esfo_frontend.clustering.track_windows import PRIOR_DEGREES, TrackWindows
from esfo_frontend.options import TrackOptions

MS = 1_000_000


def joined(corners, track_id, complete_until=None, ended=()):
    return JoinedCorners(corners, np.asarray(track_id, np.int64), complete_until or {}, list(ended))


def random_corners(rng, n, origin):
    t = np.sort(rng.integers(0, 100 * MS, n)) + origin
    return make_events(rng.integers(0, 300, n), rng.integers(0, 200, n), rng.integers(0, 2, n), t)


def test_rows_equal_a_plain_loop():
    rng = np.random.default_rng(0)
    origin = 7_000_000_123
    corners = random_corners(rng, 300, origin)
    ids = rng.integers(0, 8, 300)
    options = TrackOptions(window=30.0, min_corners=4)
    stage = TrackWindows(origin, options)
    update = stage.add(joined(corners, ids, ended=range(8)))
    expected, dropped = [], 0
    for k in range(4):
        for i in range(8):
            c = corners[(ids == i) & ((corners["t"] - origin) // (30 * MS) == k)]
            if 0 < len(c) < 4:
                dropped += 1
            if len(c) < 4:
                continue
            t = (c["t"] - origin).astype(float)
            residual = sum(np.polyfit(t - t.mean(), c[axis].astype(float), 1, full=True)[1][0] for axis in "xy")
            s2 = (PRIOR_DEGREES * options.corner_sigma**2 + residual) / (PRIOR_DEGREES + 2 * len(c) - 4)
            sigma = np.sqrt(options.min_sigma**2 + s2 / len(c))
            expected.append((i, c["t"].mean(), c["x"].mean(), c["y"].mean(), sigma))
    assert stage.dropped == dropped > 0
    rows = update.observations
    assert rows.track_id.tolist() == [e[0] for e in expected]
    assert np.abs(rows.t - np.array([e[1] for e in expected])).max() <= 512  # float64 mean of absolute ns
    assert np.allclose(rows.uv, [e[2:4] for e in expected], rtol=1e-6)
    assert np.allclose(rows.sigma, [e[4] for e in expected], rtol=1e-6)
    assert update.ended.tolist() == list(range(8))


def test_windows_wait_until_complete_and_come_once():
    rng = np.random.default_rng(1)
    corners = random_corners(rng, 90, 0)
    ids = rng.integers(0, 2, 90)
    whole = TrackWindows(0, TrackOptions()).add(joined(corners, ids, ended=[0, 1])).observations
    stage = TrackWindows(0, TrackOptions())
    first = stage.add(joined(corners[:50], ids[:50], {0: int(corners["t"][50])}))
    border = int(corners["t"][50]) // (30 * MS)
    assert set(first.observations.track_id.tolist()) == {0}  # nothing is known yet about track 1
    assert (first.observations.t < border * 30 * MS).all()
    second = stage.add(joined(corners[50:], ids[50:], ended=[0, 1]))
    assert len(second.ended) == 2
    both = np.concatenate([first.observations.t, second.observations.t])
    assert sorted(both.tolist()) == sorted(whole.t.tolist())


def test_a_track_without_a_row_is_never_mentioned():
    corners = make_events(*np.array([[1, 2], [1, 1], [1, 1], [0, 40 * MS]]))
    update = TrackWindows(0, TrackOptions(min_corners=2)).add(joined(corners, [5, 5], ended=[5]))
    assert len(update.observations) == 0
    assert update.ended.tolist() == []


@pytest.mark.parametrize("speed", [0.0, 400.0])
@pytest.mark.parametrize("n", [3, 8, 30])
def test_sigma_covers_the_error_of_the_mean_whatever_the_speed(speed, n):
    # Corners on a straight path with 1.5 px scatter, rounded to pixels; the row stands for the path at its mean time.
    rng = np.random.default_rng(n)
    z = []
    for _ in range(400):
        t = np.sort(rng.integers(0, 30 * MS, n))
        path = np.array([100.0, 80.0]) + np.outer(t / 1e9, [speed, -speed / 2])
        seen = np.rint(path + rng.normal(0, 1.5, (n, 2)))
        corners = make_events(seen[:, 0], seen[:, 1], np.ones(n), t)
        row = TrackWindows(0, TrackOptions(min_sigma=0.01)).add(joined(corners, np.zeros(n), ended=[0])).observations
        z += ((row.uv[0] - path.mean(axis=0)) / row.sigma[0]).tolist()
    # 800 values: a true standard deviation of 1 is measured to 2.5 %; the prior of 1 px makes few corners optimistic.
    assert 0.8 < np.std(z) < (1.5 if n < 8 else 1.25)
