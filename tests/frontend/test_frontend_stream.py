"""The whole front-end: truth on a clean scene, any packets, pauses, ends of streams and wrong input."""

import pickle

import numpy as np
import pytest

from esfo_core.activity import Activity
from esfo_core.camera import SensorSize
from esfo_core.errors import OptionError
from esfo_core.events import empty_events, make_events
from esfo_core.options import fields_of, replace
from esfo_core.tracks import Tracks
from esfo_frontend.clustering.chunk_clusterer import ChunkClusterer
from esfo_frontend.clustering.cluster_joiner import ClusterJoiner
from esfo_frontend.clustering.density_filter import DensityFilter
from esfo_frontend.clustering.track_windows import TrackWindows
from esfo_frontend.corners.detector import CornerDetector
from esfo_frontend.errors import FrontendError
from esfo_frontend.frontend import Frontend
from esfo_frontend.options import PRESETS, FrontendOptions

MS = 1_000_000
SIZE = SensorSize(64, 48)


def run(frontend, packets):
    outputs = [frontend.process(p) for p in packets] + [frontend.flush()]
    return outputs, Tracks.concatenate(o.tracks.observations for o in outputs)


def same_bits(a, b):
    return all(
        getattr(a, k).tobytes() == getattr(b, k).tobytes() and getattr(a, k).dtype == getattr(b, k).dtype
        for k in ("track_id", "t", "uv", "sigma")
    )


def test_tracks_follow_the_corners_of_the_squares(scene):
    outputs, tracks = run(Frontend(scene), [scene.events])
    offset = tracks.uv[:, None] - scene.corners_at(tracks.t)
    distance = np.linalg.norm(offset, axis=2)
    # An event is a corner when the corner lies within eFAST's outer circle of 4 px: rows may be so far behind it.
    assert (distance.min(axis=1) < 5).mean() > 0.85
    # Yet a track has to keep its distance, and half of the tracks have to keep it over the whole scene.
    drift, duration = [], []
    for i in np.unique(tracks.track_id):
        rows = tracks.track_id == i
        if rows.sum() > 2:
            own = offset[rows, np.argmin(distance[rows].mean(axis=0))]
            drift.append(np.linalg.norm(own - np.median(own, axis=0), axis=1).max())
            duration.append(np.ptp(tracks.t[rows]) / 1e9)
    assert np.median(drift) < 1
    assert np.median(duration) > 0.3
    ended = np.concatenate([o.tracks.ended for o in outputs])
    assert sorted(ended.tolist()) == sorted(set(tracks.track_id.tolist()))


@pytest.mark.parametrize("preset", PRESETS)
def test_packets_do_not_matter(scene, preset):
    events = scene.events[:9000]
    border = np.arange(int(events["t"][0]), int(events["t"][-1]), MS)
    cuts = {
        "one": [events],
        "events": [events[i : i + 1] for i in range(len(events))],
        "ms": np.split(events, np.searchsorted(events["t"], border)),
        "empty": [empty_events(), events[:4000], empty_events(), empty_events(), events[4000:], empty_events()],
    }
    results = {}
    for name, packets in cuts.items():
        frontend = Frontend(scene, PRESETS[preset])
        outputs, tracks = run(frontend, packets)
        activity = Activity.concatenate(o.activity for o in outputs if o.activity is not None)
        clusters = [np.concatenate([getattr(o.corners, k) for o in outputs]) for k in ("x", "y", "t", "label")]
        results[name] = tracks, activity, clusters, frontend.statistics
    tracks, activity, clusters, statistics = results["one"]
    assert len(tracks) > 20
    assert statistics.events == len(events)
    assert activity.counts.sum() == len(events)
    for name in ("events", "ms", "empty"):
        other = results[name]
        assert same_bits(tracks, other[0]), name
        assert np.array_equal(activity.counts, other[1].counts)
        assert all(np.array_equal(a, b) for a, b in zip(clusters, other[2], strict=True))
        assert statistics == other[3]


def test_the_paper_preset_is_its_stages_one_after_the_other(scene):
    options = PRESETS["paper"]
    step = round((options.clusters.chunk - options.clusters.shared) * MS)
    events, origin = scene.events, int(scene.events["t"][0])
    density = DensityFilter(scene.width, scene.height, options.time_scale, options.density)
    clusterer = ChunkClusterer(options.time_scale, options.clusters)
    joiner = ClusterJoiner(origin, options.time_scale, options.join)
    windows = TrackWindows(origin, options.tracks)
    density.add(events, CornerDetector(scene.width, scene.height, options.corners).detect(events))
    settled = []
    for end in range(origin + step, int(events["t"][-1]) + step + 1, step):
        settled.append(clusterer.add_slice(density.filter_until(end)[0], end))
    settled.append(clusterer.finish())
    expected = Tracks.concatenate(windows.add(joiner.add(s)).observations for s in settled)
    _, tracks = run(Frontend(scene, options), np.array_split(events, 7))
    assert len(expected) > 20
    assert same_bits(tracks, expected)


@pytest.mark.parametrize("preset", PRESETS)
def test_statistics_add_up(scene, preset):
    frontend = Frontend(scene, PRESETS[preset])
    outputs, tracks = run(frontend, [scene.events])
    labels = np.concatenate([o.corners.label for o in outputs])
    s = frontend.statistics
    assert s.events == len(scene.events)
    assert s.corners >= s.kept == len(labels)
    assert s.clustered == (labels >= 0).sum() > 0
    # The median speed of squares that move at 210 and 191 px/s.
    assert (180 < s.speed_px_s < 220) == (preset == "default")
    assert (s.rows, s.tracks) == (len(tracks), len(set(tracks.track_id.tolist())))


def test_columns_have_the_types_of_the_messages(scene):
    c = Frontend(scene).process(scene.events).corners
    types = [a.dtype for a in (c.x, c.y, c.polarity, c.t, c.label)]
    assert types == [np.uint16, np.uint16, np.uint8, np.int64, np.int32]


@pytest.mark.parametrize("preset", PRESETS)
def test_ids_never_come_back_and_rows_end_with_their_track(scene, preset):
    frontend = Frontend(scene, PRESETS[preset])
    ended, rows_after_end = set(), 0
    for _ in range(3):
        for packet in np.array_split(scene.events, 20):
            update = frontend.process(packet).tracks
            rows_after_end += len(ended & set(update.observations.track_id.tolist()))
            ended |= set(update.ended.tolist())
        last = frontend.flush().tracks
        rows_after_end += len(ended & set(last.observations.track_id.tolist()))
        assert not ended & set(last.ended.tolist())
        ended |= set(last.ended.tolist())
    assert rows_after_end == 0
    assert frontend.statistics.tracks == len(ended)


def test_a_new_stream_equals_a_first_one(scene):
    frontend = Frontend(scene)
    _, first = run(frontend, [scene.events])
    _, second = run(frontend, [scene.events])
    shift = second.track_id - first.track_id
    assert (shift == shift[0]).all()
    assert shift[0] > 0
    assert same_bits(first, Tracks(second.track_id - shift[0], second.t, second.uv, second.sigma))


def test_activity_of_streams_that_follow_one_another_fits_together(scene):
    frontend = Frontend(scene)
    outputs = []
    for packet in np.split(scene.events, [5000, 11_000, 20_000]):
        outputs += run(frontend, [packet])[0]
    activity = Activity.concatenate(o.activity for o in outputs if o.activity is not None)
    assert activity.counts.sum() == len(scene.events) - frontend.statistics.uncounted_events


def test_a_long_pause_costs_nothing_and_ends_tracks(scene):
    year = 365 * 86_400 * 1_000_000_000
    later = scene.events.copy()
    later["t"] += year
    frontend = Frontend(scene)
    outputs = [frontend.process(np.concatenate([scene.events, later])), frontend.flush()]
    tracks = Tracks.concatenate(o.tracks.observations for o in outputs)
    before, after = tracks.t < year, tracks.t >= year
    assert before.sum() > 50 < after.sum()
    assert not set(tracks.track_id[before].tolist()) & set(tracks.track_id[after].tolist())
    assert [int(o.activity.counts.sum()) for o in outputs] == [len(scene.events), len(later)]
    assert outputs[0].activity.t0 < year <= outputs[1].activity.t0


def test_nothing_comes_of_nothing():
    frontend = Frontend(SIZE)
    for output in (frontend.flush(), frontend.process(empty_events()), frontend.flush()):
        assert len(output.corners) == len(output.tracks.observations) == len(output.tracks.ended) == 0
        assert output.activity is None


def test_single_event():
    frontend = Frontend(SIZE)
    assert frontend.process(make_events(*np.array([[5], [6], [1], [12345]]))).activity is None
    activity = frontend.flush().activity
    assert (activity.t0, activity.counts.sum()) == (12345, 1)


@pytest.mark.parametrize(
    ("rows", "word"),
    [
        ([(1, 1, 1, 100), (1, 1, 1, 93)], "7 ns"),
        ([(1, 1, 1, 49)], "1 ns"),
        ([(64, 1, 1, 100)], r"\(64, 1\)"),
        ([(1, 48, 1, 100)], r"\(1, 48\)"),
        ([(1, 1, 2, 100)], "polarity 2"),
        ([(1, 1, -1, 100)], "polarity -1"),
        ([(1, 1, 1, 10**11), (1, 1, 1, 2 * 10**11)], "pauses"),
    ],
)
def test_wrong_events_are_refused_and_change_nothing(rows, word):
    good = make_events(*np.array([[1, 2], [1, 2], [1, 0], [0, 50]]))
    frontend = Frontend(SIZE)
    frontend.process(good)
    with pytest.raises(FrontendError, match=word):
        frontend.process(make_events(*np.array(rows).T))
    assert frontend.statistics.events == 2
    frontend.process(make_events(*np.array([[3], [3], [1], [50]])))
    assert frontend.flush().activity.counts.sum() == 3


def test_time_may_go_back_after_a_flush():
    frontend = Frontend(SIZE)
    run(frontend, [make_events(*np.array([[1], [1], [1], [10**12]]))])
    outputs, _ = run(frontend, [make_events(*np.array([[1], [1], [1], [7]]))])
    assert outputs[-1].activity.t0 == 7


def test_memory_does_not_grow_with_the_stream(scene):
    frontend = Frontend(scene)
    size = []
    for k in range(5):
        events = scene.events.copy()
        events["t"] += k * 500 * MS
        for packet in np.array_split(events, 10):
            frontend.process(packet)
        size.append(len(pickle.dumps(frontend)))
    assert max(size) - min(size) < 0.3 * scene.events.nbytes


@pytest.mark.parametrize(
    "values",
    [
        {"clusters.shared": 61.0, "clusters.chunk": 120.0},
        {"corners.shortest_inner": 7},
        {"corners.shortest_outer": 9},
    ],
)
def test_contradicting_options_are_refused(values):
    with pytest.raises(OptionError, match=next(iter(values))):
        Frontend(SIZE, replace(FrontendOptions(), values))


def test_presets_are_within_their_ranges_and_paper_is_table_2():
    for options in PRESETS.values():
        Frontend(SIZE, options)
    paper = {leaf.name: leaf.value for leaf in fields_of(PRESETS["paper"])}
    table = {"density.radius": 7, "clusters.min_size": 10, "clusters.epsilon": 5, "join.radius": 30}
    table |= {"join.descriptor_size": 5, "tracks.window": 30}
    assert {name: paper[name] for name in table} == table
