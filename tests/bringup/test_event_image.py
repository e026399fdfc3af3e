"""Events gathered for the picture of a run, against all events kept."""

import numpy as np
import pytest

from esfo_bringup.results.event_image import LONGEST_MOMENT_NS, EventImage
from esfo_core.events import empty_events, make_events

WIDTH, HEIGHT, START = 7, 5, 3_000_000_123


def stream(duration_ns, count=3000, seed=1):
    rng = np.random.default_rng(seed)
    t = START + np.sort(rng.integers(0, duration_ns, count))
    t[[0, -1]] = START, START + duration_ns
    return make_events(rng.integers(0, WIDTH, count), rng.integers(0, HEIGHT, count), rng.integers(0, 2, count), t)


def gathered(events, pieces):
    event_image = EventImage(WIDTH, HEIGHT)
    for piece in np.array_split(events, pieces):
        event_image.add(piece)
    return event_image


@pytest.mark.parametrize("duration_s", [0.02, 0.1, 0.35, 1.0, 3.7, 100.0])
@pytest.mark.parametrize("pieces", [1, 7, 3000])
def test_all_events_are_counted_and_a_moment_of_them_is_kept(duration_s, pieces):
    duration = round(duration_s * 1e9)
    events = stream(duration, count=30_000)
    event_image = gathered(events, pieces)
    slow = np.zeros((2, HEIGHT, WIDTH), int)
    for e in events:
        slow[e["p"], e["y"], e["x"]] += 1
    assert (event_image.counts == slow).all()
    assert (event_image.count(events) == slow).all()
    for length in (LONGEST_MOMENT_NS, 30_000_000):
        moment = event_image.moment(length)
        start = START + next((d for d in (LONGEST_MOMENT_NS * 2**k for k in range(20, -1, -1)) if 2 * d <= duration), 0)
        inside = (events["t"] >= start) & (events["t"] < start + length)
        assert (moment == events[inside]).all()


def test_what_is_kept_does_not_grow():
    event_image = gathered(stream(10**12, count=200_000), 5000)
    kept = sum(len(part) for moments in event_image._moments for part in moments)
    assert kept <= 2 * 200_000 * LONGEST_MOMENT_NS / 10**12 * 2


def test_pauses_and_nothing_at_all():
    event_image = EventImage(WIDTH, HEIGHT)
    assert len(event_image.moment(LONGEST_MOMENT_NS)) == 0
    event_image.add(empty_events())
    early, late = stream(50_000_000, 10), stream(50_000_000, 10)
    late["t"] += 3600 * 10**9
    event_image.add(early)
    assert len(event_image.moment(LONGEST_MOMENT_NS)) == 10
    event_image.add(late)
    assert event_image.counts.sum() == 20
    assert len(event_image.moment(LONGEST_MOMENT_NS)) <= 10
