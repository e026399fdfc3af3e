"""eFAST against a plain twin that tries every arc, with times that tie."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_core.events import make_events
from esfo_frontend.corners import BORDER, INNER_CIRCLE, OUTER_CIRCLE, CornerDetector, _has_arc
from esfo_frontend.options import CornerOptions

RINGS = st.integers(0, 9)


def has_arc_twin(ring, shortest, longest):
    """Every start and length: all of the arc newer than all of the rest."""
    n = len(ring)
    for start in range(n):
        for length in range(shortest, longest + 1):
            turned = np.roll(ring, -start)
            if turned[:length].min() > turned[length:].max():
                return True
    return False


def detect_twin(events, width, height):
    surface = np.full((2, height, width), np.iinfo(np.int64).min, np.int64)
    corner = []
    for x, y, p, t in events.tolist():
        surface[p, y, x] = t
        inside = BORDER <= x < width - BORDER and BORDER <= y < height - BORDER
        corner.append(
            inside
            and has_arc_twin(surface[p, y + INNER_CIRCLE[1], x + INNER_CIRCLE[0]], 3, 6)
            and has_arc_twin(surface[p, y + OUTER_CIRCLE[1], x + OUTER_CIRCLE[0]], 4, 8)
        )
    return np.array(corner, bool)


@pytest.mark.parametrize("circle", [INNER_CIRCLE, OUTER_CIRCLE])
def test_circles_are_closed_symmetric_rings(circle):
    points = list(zip(*circle.tolist(), strict=True))
    assert len(set(points)) == len(points)
    assert set(points) == {(-y, x) for x, y in points}
    step = np.abs(circle - np.roll(circle, 1, axis=1)).max(axis=0)
    assert (step == 1).all()


@settings(max_examples=500, deadline=None)
@given(st.sampled_from([(16, 3, 6), (20, 4, 8)]).flatmap(
    lambda c: st.tuples(st.just(c), st.lists(RINGS, min_size=c[0], max_size=c[0]))
))  # fmt: skip
def test_arc_search_equals_twin_on_ties(case):
    (size, shortest, longest), values = case
    ring = np.array(values, np.int64)
    assert _has_arc(ring, size, shortest, longest) == has_arc_twin(ring, shortest, longest)


@settings(max_examples=500, deadline=None)
@given(st.integers(0, 15), st.integers(1, 9), st.lists(RINGS, min_size=16, max_size=16))
def test_arc_search_equals_twin_on_planted_arcs(start, length, values):
    ring = np.array(values, np.int64)
    ring[np.arange(start, start + length) % 16] += 9
    assert _has_arc(ring, 16, 3, 6) == has_arc_twin(ring, 3, 6)


@pytest.mark.parametrize("length", range(1, 21))
def test_only_the_allowed_arc_lengths_pass(length):
    for size, shortest, longest in ((16, 3, 6), (20, 4, 8)):
        ring = np.zeros(size, np.int64)
        ring[: min(length, size)] = 1
        assert _has_arc(ring, size, shortest, longest) == (shortest <= length <= longest)


def test_detector_equals_twin_on_a_scene(scene):
    events = scene.events[:6000].copy()
    events["t"] -= events["t"] % 2_000_000  # many ties
    found = CornerDetector(scene.width, scene.height, CornerOptions()).detect(events)
    assert found.sum() > 50
    assert np.array_equal(found, detect_twin(events, scene.width, scene.height))


def test_corner_events_lie_at_corners(scene):
    corners = scene.events[CornerDetector(scene.width, scene.height, CornerOptions()).detect(scene.events)]
    at = np.stack([corners["x"], corners["y"]], axis=1).astype(float)
    distance = np.linalg.norm(at[:, None] - scene.corners_at(corners["t"]), axis=2).min(axis=1)
    # The outer circle has a radius of 4 px.
    assert (distance < 5).mean() > 0.98


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_detector_equals_twin_on_random_events_in_pieces(data):
    n = data.draw(st.integers(0, 300))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    width, height = data.draw(st.integers(1, 14)), data.draw(st.integers(1, 14))
    t = np.cumsum(rng.integers(0, 2, n)) + data.draw(st.sampled_from([-100, 0, 2**60]))
    events = make_events(rng.integers(0, width, n), rng.integers(0, height, n), rng.integers(0, 2, n), t)
    detector = CornerDetector(width, height, CornerOptions())
    pieces = np.split(events, np.sort(rng.integers(0, n + 1, 3)))
    found = np.concatenate([detector.detect(piece) for piece in pieces])
    assert np.array_equal(found, detect_twin(events, width, height))


def test_corner_of_a_growing_square_is_found_and_border_is_not():
    # A square's corner passes pixel by pixel: newest pixels form a right-angled wedge.
    def wedge(x0, y0, width, height):
        steps = [(x0 - i, y0 - j, max(-i, -j)) for i in range(-5, 6) for j in range(-5, 6)]
        steps = [(x, y, s) for x, y, s in steps if 0 <= x < width and 0 <= y < height]
        x, y, s = (np.array(c) for c in zip(*sorted(steps, key=lambda e: e[2]), strict=True))
        keep = s <= 0
        return make_events(x[keep], y[keep], np.ones(keep.sum()), s[keep] + 10)

    found = {}
    for x0 in (BORDER - 1, BORDER, 20 - BORDER - 1, 20 - BORDER):
        events = wedge(x0, 10, 20, 20)
        mask = CornerDetector(20, 20, CornerOptions()).detect(events)
        found[x0] = {(int(e["x"]), int(e["y"])) for e in events[mask]}
    assert all(BORDER <= x < 20 - BORDER and BORDER <= y < 20 - BORDER for f in found.values() for x, y in f)
    assert (BORDER, 10) in found[BORDER]
