"""Association of corners with tracks: equal to a plain twin, the same at any speed, and true to known paths."""

import numpy as np
import pytest

from esfo_core.events import empty_events, make_events
from esfo_core.tracks import Tracks
from esfo_frontend.association.corner_association import CornerAssociation
from esfo_frontend.association.kernels import Limits, set_deadline, update_track
from esfo_frontend.association.track_table import SHARED_DTYPE, TRACK_DTYPE
from esfo_frontend.clustering.track_windows import sigma_of_mean
from esfo_frontend.options import AssociationOptions, TrackOptions

MS = 1_000_000
SIZE = (120, 90)

# Constants of the method, from their derivations and not from the code.
SPEED_STEP = 1 + 1 / 500
"""500 corners that are all faster than the typical speed raise it by a factor of e: twice that is its memory."""
SLOWEST = 0.1
"""A track that stands still forgets its corners ten times more slowly than one with the typical speed."""
CHANCE_PX2 = 1.0**2 + 1.0**2
"""Corners scatter by 1 px in both coordinates: the path that this scatter explains by chance, squared."""
LEAST_FOR_VELOCITY = 4
"""A line has two unknowns in each coordinate; below twice as many corners the velocity stays 0."""
UNPROVEN = 0.5
"""A track without an id may coast half as far as one with an id."""
PRIOR_DEGREES = 2 * 4 - 4
"""The expected scatter counts as much as a row of four corners: eight coordinates less the four unknowns of a line."""


class PlainTrack:
    """A track that keeps all its corners and fits everything anew each time."""

    def __init__(self, corner, born):
        self.born, self.id, self.polarity = born, -1, corner[2]
        self.corners, self.row = [], []
        self.t, self.place, self.velocity = corner[3], np.array(corner[:2], float), np.zeros(2)

    def predicted(self, t):
        return self.place + self.velocity * (t - self.t) / 1e9

    def fit(self, corner, keep):
        self.corners = [(w * keep, t, x) for w, t, x in self.corners] + [(1.0, corner[3], np.array(corner[:2], float))]
        self.t = corner[3]
        w = np.array([c[0] for c in self.corners])
        t = np.array([(c[1] - self.t) / 1e9 for c in self.corners])
        x = np.array([c[2] for c in self.corners])
        mean_t, mean_x = np.average(t, weights=w), np.average(x, axis=0, weights=w)
        spread = (w * (t - mean_t) ** 2).sum()
        if spread > 0 and len(t) >= LEAST_FOR_VELOCITY:
            v = (w * (t - mean_t)) @ (x - mean_x) / spread
            explained = v @ v * spread
            self.velocity = v * explained / (explained + CHANCE_PX2)
        self.place = mean_x - self.velocity * mean_t


class PlainAssociation:
    """`CornerAssociation` without a grid, a table or running sums."""

    def __init__(self, options, tracks):
        self.o, self.t, self.alive, self.born, self.next_id, self.speed = options, tracks, [], 0, 0, 0.0

    def add(self, corners, end):
        labels, rows = [], []
        for c in corners.tolist():
            labels.append(self.corner(c, rows))
        gone = [k for k in self.alive if k.deadline < end]
        self.alive = [k for k in self.alive if k.deadline >= end]
        return labels, rows, sorted(k.id for k in gone if k.id >= 0)

    def corner(self, c, rows):
        same = [k for k in self.alive if k.polarity == c[2] and c[3] <= k.deadline]
        distance = {k: np.linalg.norm(k.predicted(c[3]) - c[:2]) for k in same}
        inside = [k for k in same if distance[k] <= self.o.gate]
        if inside:
            track = min(inside, key=lambda k: (distance[k], k.born))
        elif any(k.id >= 0 and distance[k] < self.o.spacing for k in same):
            return -1
        else:
            track = PlainTrack(c, self.born)
            self.born += 1
            self.alive.append(track)
        motion = max(np.linalg.norm(track.velocity), SLOWEST * self.speed) * (c[3] - track.t) / 1e9
        track.fit(c, np.exp(-motion / self.o.memory))
        self.plan(track)
        self.row(track, c, rows)
        return track.id

    def plan(self, track):
        speed, coast = np.linalg.norm(track.velocity), self.o.coast
        if track.id < 0:
            coast *= UNPROVEN
        elif speed > 0:
            self.speed = self.speed or speed
            self.speed *= SPEED_STEP if speed > self.speed else 1 / SPEED_STEP
        gaps = [self.o.longest_gap * MS]
        gaps += [1e9 * coast / speed] if speed else []
        gaps += [1e9 * self.o.wait / self.speed] if self.speed else []
        track.deadline = track.t + int(min(gaps))

    def row(self, track, c, rows):
        if not track.row:
            track.row_place = track.place
        track.row.append((c[3], c[0], c[1]))
        if len(track.row) < self.t.min_corners or np.linalg.norm(track.place - track.row_place) < self.o.step:
            return
        if track.id < 0 and len(track.corners) >= self.o.first_corners:
            track.id, self.next_id = self.next_id, self.next_id + 1
        if track.id >= 0:
            t, u, v, sigma = self.mean(np.array(track.row))
            ahead = self.o.lag * track.velocity / np.linalg.norm(track.velocity)
            rows.append((track.id, t, u + ahead[0], v + ahead[1], sigma))
        track.row = []

    def mean(self, row):
        n, t, x = len(row), row[:, 0].astype(float), row[:, 1:].astype(float)
        line = np.stack([np.ones(n), (t - t[0]) / 1e6], axis=1)
        residual = ((x - line @ np.linalg.lstsq(line, x, rcond=None)[0]) ** 2).sum()
        s2 = (PRIOR_DEGREES * self.t.corner_sigma**2 + residual) / (PRIOR_DEGREES + 2 * n - 4)
        return t.mean(), *x.mean(axis=0), np.sqrt(self.t.min_sigma**2 + s2 / n)


def moving_points(rng, paths, rate_per_px, t0=0, scatter=0.7):
    """Corners about points in straight motion: paths of (x, y, vx, vy, begin ms, end ms, polarity)."""
    parts = []
    for x, y, vx, vy, begin, end, p in paths:
        n = int(rate_per_px * np.hypot(vx, vy) * (end - begin) / 1e3)
        t = rng.integers(int(begin * MS), int(end * MS), n)
        xy = np.array([x, y]) + np.outer(t / 1e9 - begin / 1e3, [vx, vy]) + rng.normal(0, scatter, (n, 2))
        xy = np.clip(np.rint(xy), 0, [SIZE[0] - 1, SIZE[1] - 1])
        parts.append(make_events(xy[:, 0], xy[:, 1], np.full(n, p), t + t0))
    corners = np.concatenate(parts)
    return corners[np.argsort(corners["t"], kind="stable")]


def noise(rng, n, end_ms):
    t = np.sort(rng.integers(0, end_ms * MS, n))
    return make_events(rng.integers(0, SIZE[0], n), rng.integers(0, SIZE[1], n), rng.integers(0, 2, n), t)


def random_stream(seed):
    rng = np.random.default_rng(seed)
    paths = [
        (*rng.uniform(10, 80, 2), *rng.uniform(-150, 150, 2), *np.sort(rng.uniform(0, 300, 2)), rng.integers(0, 2))
        for _ in range(16)
    ]
    corners = np.concatenate([moving_points(rng, paths, 3.0), noise(rng, 300, 300)])
    corners["t"] -= corners["t"] % (MS // 5)  # many corners at the same time
    return corners[np.argsort(corners["t"], kind="stable")]


def follow(corners, options=AssociationOptions(), tracks=TrackOptions(), step=5 * MS):  # noqa: B008
    """Return labels, rows and ended tracks of a whole stream, taken in slices of `step` ns."""
    stage = CornerAssociation(*SIZE, options, tracks)
    labels, updates = [], []
    end = 0
    while end <= corners["t"][-1]:
        label, update = stage.add(corners[(corners["t"] >= end) & (corners["t"] < end + step)], end + step)
        end += step
        labels.append(label)
        updates.append(update)
    updates.append(stage.add(empty_events(), np.iinfo(np.int64).max)[1])
    assert stage.idle
    rows = Tracks.concatenate(u.observations for u in updates)
    return np.concatenate(labels), rows, np.concatenate([u.ended for u in updates])


OTHER = AssociationOptions(
    gate=3.0, spacing=0.0, memory=8.0, coast=2.0, wait=1000.0, longest_gap=40.0, step=2.1, lag=0.0, first_corners=6
)


@pytest.mark.parametrize("options", [AssociationOptions(), OTHER], ids=["default", "other"])
@pytest.mark.parametrize("seed", range(5))
def test_equals_the_plain_twin(seed, options):
    corners = random_stream(seed)
    label, rows, ended = follow(corners, options)
    plain = PlainAssociation(options, TrackOptions())
    expected_labels, expected, expected_ended = [], [], []
    for end in range(5 * MS, 310 * MS, 5 * MS):
        part = corners[(corners["t"] >= end - 5 * MS) & (corners["t"] < end)]
        for found, total in zip(plain.add(part, end), (expected_labels, expected, expected_ended), strict=True):
            total.extend(found)
    expected_ended += sorted(k.id for k in plain.alive if k.id >= 0)
    assert label.tolist() == expected_labels
    assert len(expected) > 5
    assert ended.tolist() == expected_ended
    ids, t, *uvs = np.array(expected).T
    assert rows.track_id.tolist() == ids.tolist()
    assert np.abs(rows.t - t).max() <= 1
    assert np.allclose(np.column_stack([rows.uv, rows.sigma]), np.transpose(uvs), rtol=0, atol=1e-4)


@pytest.mark.parametrize("factor", [0.02, 0.1, 7.0])
def test_the_same_places_at_any_speed(factor):
    # Slower or faster, the same corners in the same order: all that is decided in pixels stays as it is.
    corners = random_stream(3)
    options = AssociationOptions(longest_gap=60_000.0)
    _, rows, _ = follow(corners, options)
    other = corners.copy()
    other["t"] = corners["t"] * factor
    _, scaled, _ = follow(other, options, step=int(5 * MS * factor))
    assert rows.track_id.tolist() == scaled.track_id.tolist()
    assert np.allclose(rows.uv, scaled.uv, atol=1e-3)
    assert np.allclose(rows.t * factor, scaled.t, atol=2)


def test_slices_of_any_length_give_the_same():
    corners = random_stream(1)
    label, rows, ended = follow(corners)
    for step in (MS // 5, 33 * MS, 1000 * MS):
        other = follow(corners, step=step)
        assert np.array_equal(label, other[0])
        assert rows.uv.tobytes() == other[1].uv.tobytes()
        assert sorted(ended) == sorted(other[2])


def test_parallel_paths_closer_than_their_motion_stay_apart():
    # 7 px apart along the motion: each is soon where the other was, which a distance in space and time cannot tell.
    rng = np.random.default_rng(0)
    paths = [(20 + 7 * k, 40, 400.0, 0.0, 0, 150, 1) for k in range(3)]
    _, rows, _ = follow(moving_points(rng, paths, 4.0))
    at_begin = rows.uv[:, 0] - 400.0 * rows.t / 1e9
    for i in np.unique(rows.track_id):
        own = at_begin[rows.track_id == i]
        assert np.ptp(own) < 3
        assert np.abs(own.mean() - [20, 27, 34]).min() < 1
    assert len(np.unique(rows.track_id)) == 3


@pytest.mark.parametrize(("gap_px", "same"), [(3.0, True), (8.0, False)])
def test_a_gap_is_bridged_up_to_the_coasting_distance(gap_px, same):
    rng = np.random.default_rng(2)
    v, gap = 100.0, 10.0 * gap_px
    paths = [(10, 40, v, 0.0, 0, 300, 1), (10 + v * (0.3 + gap / 1e3), 40, v, 0.0, 300 + gap, 600 + gap, 1)]
    _, rows, _ = follow(moving_points(rng, paths, 5.0, scatter=0.3))
    assert (len(np.unique(rows.track_id)) == 1) == same


def test_scattered_corners_make_no_track():
    label, rows, ended = follow(noise(np.random.default_rng(5), 400, 1000))
    assert len(rows) == len(ended) == 0
    assert (label == -1).all()


def test_polarities_are_kept_apart():
    rng = np.random.default_rng(6)
    paths = [(20, 40, 100.0, 0.0, 0, 500, p) for p in (0, 1)]
    corners = moving_points(rng, paths, 4.0)
    label, _, _ = follow(corners)
    assert not set(label[corners["p"] == 0]) & set(label[corners["p"] == 1]) - {-1}


def test_sigma_covers_the_error_of_the_mean():
    # 0.6 px and rounding make 0.67 px: the gate is then at 3.7 standard deviations and takes nothing away.
    rng = np.random.default_rng(7)
    paths = [(10, 5 + 10 * k, 150.0, 0.0, 0, 600, 1) for k in range(8)]
    corners = moving_points(rng, paths, 3.0, scatter=0.6)
    _, rows, _ = follow(corners, AssociationOptions(lag=0.0), TrackOptions(min_sigma=0.01))
    error = rows.uv - np.column_stack([10 + 150.0 * rows.t / 1e9, 5 + 10 * np.rint((rows.uv[:, 1] - 5) / 10)])
    assert len(rows) > 150
    # The prior of 1 px counts for 4 of some 20 degrees of freedom, so that the stated error is a little too large.
    assert 0.8 < np.sqrt(((error / rows.sigma[:, None]) ** 2).mean()) < 1.2


def test_rows_are_moved_ahead_by_the_lag():
    rng = np.random.default_rng(8)
    corners = moving_points(rng, [(10, 20, 120.0, 90.0, 0, 600, 1)], 4.0)
    still, moved = (follow(corners, AssociationOptions(lag=lag))[1] for lag in (0.0, 2.0))
    assert len(still) > 10
    # The direction is that of the track, which 0.7 px of scatter turn by some degrees.
    assert np.abs(moved.uv - still.uv - 2.0 * np.array([0.8, 0.6])).max() < 1.0
    assert np.abs((moved.uv - still.uv).mean(axis=0) - [1.6, 1.2]).max() < 0.1


def records(**values):
    """Return a track with an id and these values, and what the tracks share, as the kernels take them."""
    track, shared = np.zeros(1, TRACK_DTYPE).view(np.recarray)[0], np.zeros(1, SHARED_DTYPE).view(np.recarray)[0]
    for name, value in values.items():
        track[name] = value
    return track, shared


LIMITS = Limits(9.0, 25.0, 5.0, 4.0, 20.0, 1e9, 4.0, 0.0, 6, 4)


def test_the_typical_speed_doubles_within_350_faster_corners():
    track, shared = records(vx=1000.0)
    shared.speed = 100.0
    corners = 0
    while shared.speed < 200.0:
        set_deadline(track, shared, LIMITS)
        corners += 1
    assert corners == np.ceil(500 * np.log(2)) == 347


def test_a_track_that_stands_forgets_a_tenth_as_fast_as_a_typical_one():
    kept = []
    for vx, typical in ((0.0, 80.0), (8.0, 0.0)):
        track, shared = records(vx=vx, s1=1.0)
        shared.speed = typical
        update_track(track, 0.0, 0.0, 100 * MS, shared, LIMITS)
        kept.append(track.s1 - 1.0)
    assert kept == pytest.approx([np.exp(-8.0 * 0.1 / LIMITS.memory)] * 2)


def test_the_expected_scatter_counts_as_much_as_a_row_of_four_corners():
    options = TrackOptions(corner_sigma=2.0, min_sigma=0.3)
    measured = np.array([0.0, 36.0])  # sums of squared distances from the line, px^2
    sigma = sigma_of_mean(np.array([4, 4]), measured, np.array([True, True]), options)
    variance = (2.0**2 + measured / 4) / 2  # the mean of the expected and of the measured variance
    assert sigma == pytest.approx(np.sqrt(0.3**2 + variance / 4))


def test_memory_is_that_of_the_living_tracks():
    stage = CornerAssociation(*SIZE, AssociationOptions(), TrackOptions())
    size = []
    for k in range(40):
        corners = noise(np.random.default_rng(k), 2000, 100)
        corners["t"] += k * 100 * MS
        stage.add(corners, (k + 1) * 100 * MS)
        size.append(len(stage._tracks))
    assert size[-1] == size[5]
