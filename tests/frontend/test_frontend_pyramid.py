"""The front-end counts activity at all resolutions: across streams, with what was lost known as missing."""

import numpy as np

from esfo_core.activity_pyramid import BINS, ActivityPyramid
from esfo_core.camera import SensorSize
from esfo_core.events import make_events
from esfo_frontend.frontend import Frontend

MS = 1_000_000
SIZE = (64, 48)


def events_between(begin, end, seed=0, n=4000):
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(begin, end, n))
    return make_events(rng.integers(6, SIZE[0] - 6, n), rng.integers(5, SIZE[1] - 5, n), rng.integers(0, 2, n), t)


def level_of(outputs, bin_ns):
    pyramid = ActivityPyramid()
    for output in outputs:
        pyramid.add(output.pyramid)
    assert {level.bin for level in pyramid.levels()} <= set(BINS)
    return next(level for level in pyramid.levels() if level.bin == bin_ns)


def test_the_pyramid_goes_on_after_a_flush():
    frontend = Frontend(SensorSize(*SIZE))
    outputs = [frontend.process(events_between(0, 200 * MS)), frontend.flush()]
    outputs += [frontend.process(events_between(400 * MS, 600 * MS, 1)), frontend.flush()]
    level = level_of(outputs, 4_096_000)
    assert level.t0 == 0
    assert level.counts.sum(dtype=int) > 7500
    assert level.end > 600 * MS - level.bin  # the last bin counts if half of it was seen


def test_what_was_lost_is_missing():
    frontend = Frontend(SensorSize(*SIZE))
    outputs = [frontend.process(events_between(0, 200 * MS))]
    frontend.miss(200 * MS, 300 * MS)
    outputs += [frontend.process(events_between(300 * MS, 500 * MS, 1)), frontend.flush()]
    level = level_of(outputs, 4_096_000)
    middle = level.t0 + level.bin * (np.arange(len(level.counts)) + 0.5)
    lost = (middle > 205 * MS) & (middle < 295 * MS)
    assert not level.valid[lost].any()
    assert level.valid[~lost][1:-1].mean() > 0.95


def test_a_clock_that_goes_back_begins_anew():
    frontend = Frontend(SensorSize(*SIZE))
    frontend.process(events_between(1000 * MS, 1200 * MS))
    frontend.flush()
    level = level_of([frontend.process(events_between(0, 200 * MS)), frontend.flush()], 4_096_000)
    assert level.t0 == 0
    assert level.end < 210 * MS
