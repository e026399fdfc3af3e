"""eFAST and Arc* against plain twins, with times that tie, borders, pauses and any packets."""

import numpy as np
import pytest
from corner_twins import USUAL, arc_star_twin, efast_twin, has_arc_twin
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from esfo_core.errors import OptionError
from esfo_core.events import make_events
from esfo_frontend.corners import efast
from esfo_frontend.corners.active_surface import BORDER, INNER_CIRCLE, OUTER_CIRCLE
from esfo_frontend.corners.arc_star import ArcStarDetector
from esfo_frontend.corners.detector import CornerDetector
from esfo_frontend.corners.efast import EfastDetector
from esfo_frontend.errors import FrontendError
from esfo_frontend.options import CornerOptions, FrontendOptions, check_options

SETTINGS = {
    "efast": CornerOptions(),
    "arc_star": CornerOptions(detector="arc_star", kappa=0.000_005),
    "arc_star without its filter": CornerOptions(detector="arc_star", kappa=0.0),
}
INT32_MAX = 2**31 - 1
_inner_mask, _outer_mask, _has_arc = efast._inner_mask, efast._outer_mask, efast._has_arc


def twin(events, size, options):
    lengths = (options.shortest_inner, options.longest_inner, options.shortest_outer, options.longest_outer)
    if options.detector == "arc_star":
        return arc_star_twin(events, size, lengths, round(options.kappa * 1e6))
    return efast_twin(*(np.ascontiguousarray(events[name]) for name in "xypt"), size, lengths)


@njit
def rings_with_arcs(rings, circle, lengths):
    """Decisions (N,) for rings (N, n) of values, each written around the middle of a 9x9 surface."""
    found = np.zeros(len(rings), np.bool_)
    offsets = circle[1] * 9 + circle[0]
    surface = np.zeros(81, np.int32)
    for i in range(len(rings)):
        for j in range(len(offsets)):
            surface[40 + offsets[j]] = rings[i, j]
        mask = _inner_mask(surface, 40, 9) if len(offsets) == 16 else _outer_mask(surface, 40, 9)
        found[i] = _has_arc(mask, surface, 40, offsets, lengths)
    return found


@njit
def rings_with_arcs_twin(rings, shortest, longest):
    found = np.zeros(len(rings), np.bool_)
    for i in range(len(rings)):
        found[i] = has_arc_twin(rings[i], shortest, longest)
    return found


def random_events(rng, n, size, t):
    return make_events(rng.integers(0, size[0], n), rng.integers(0, size[1], n), rng.integers(0, 2, n), t)


@pytest.mark.parametrize("circle", [INNER_CIRCLE, OUTER_CIRCLE])
def test_circles_are_closed_symmetric_rings(circle):
    points = list(zip(*circle.tolist(), strict=True))
    assert len(set(points)) == len(points)
    assert set(points) == {(-y, x) for x, y in points}
    step = np.abs(circle - np.roll(circle, 1, axis=1)).max(axis=0)
    assert (step == 1).all()


@pytest.mark.parametrize(("circle", "lengths"), [(INNER_CIRCLE, (16, 3, 6)), (OUTER_CIRCLE, (20, 4, 8))])
def test_arcs_equal_the_twin_on_every_kind_of_ring(circle, lengths):
    rng = np.random.default_rng(5)
    n, shortest, longest = lengths
    share = {}
    for levels in (2, 3, 5, 9, 30, 2**30):
        for lift in (0, 1, levels // 2, levels):
            rings = rng.integers(0, levels, (20_000, n)).astype(np.int64)
            # Half of them with an arc of any length and place, newer by `lift`.
            at = (np.arange(n) - rng.integers(0, n, (10_000, 1))) % n < rng.integers(1, longest + 3, (10_000, 1))
            rings[:10_000][at] += lift
            found = rings_with_arcs(rings, circle, lengths)
            assert np.array_equal(found, rings_with_arcs_twin(rings, shortest, longest))
            share[levels, lift] = found.mean()
    assert min(share.values()) < 0.01
    # Half of the rings have a planted arc, half of those one of allowed length.
    assert max(share.values()) > 0.2


@pytest.mark.parametrize("length", range(1, 21))
def test_only_the_allowed_arc_lengths_pass(length):
    for circle, (size, shortest, longest) in ((INNER_CIRCLE, (16, 3, 6)), (OUTER_CIRCLE, (20, 4, 8))):
        ring = np.zeros((1, size), np.int64)
        ring[0, : min(length, size)] = 1
        assert rings_with_arcs(ring, circle, (size, shortest, longest))[0] == (shortest <= length <= longest)


@pytest.mark.parametrize("name", SETTINGS)
def test_detector_equals_twin_on_a_scene(scene, name):
    options, size = SETTINGS[name], (scene.width, scene.height)
    events = scene.events[:6000].copy()
    events["t"] -= events["t"] % 2_000_000  # many ties
    found = CornerDetector(*size, options).detect(events)
    assert found.sum() > 50
    assert np.array_equal(found, twin(events, size, options))


@pytest.mark.parametrize("name", SETTINGS)
def test_corner_events_lie_at_corners(scene, name):
    options = CornerOptions(detector=SETTINGS[name].detector)
    corners = scene.events[CornerDetector(scene.width, scene.height, options).detect(scene.events)]
    assert len(corners) > 200
    at = np.stack([corners["x"], corners["y"]], axis=1).astype(float)
    distance = np.linalg.norm(at[:, None] - scene.corners_at(corners["t"]), axis=2).min(axis=1)
    # The outer circle has a radius of 4 px; Arc* also takes what passes within its reach.
    assert (distance < 5).mean() > (0.98 if options.detector == "efast" else 0.8)


@settings(max_examples=60, deadline=None)
@given(st.data(), st.sampled_from(sorted(SETTINGS)))
def test_detector_equals_twin_on_random_events_in_pieces(data, name):
    n = data.draw(st.integers(0, 300))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    size = data.draw(st.integers(1, 14)), data.draw(st.integers(1, 14))
    step = rng.choice(data.draw(st.sampled_from([[0, 1], [0, 1, 7], [0, 1, 2**40], [1], [0]])), n)
    t = np.cumsum(step) + data.draw(st.sampled_from([-100, 0, 2**50]))
    events = random_events(rng, n, size, t)
    detector = CornerDetector(*size, SETTINGS[name])
    pieces = np.split(events, np.sort(rng.integers(0, n + 1, 3)))
    found = np.concatenate([detector.detect(piece) for piece in pieces])
    assert np.array_equal(found, twin(events, size, SETTINGS[name]))


@pytest.mark.parametrize("lengths", [(1, 15, 1, 19), (2, 5, 6, 12)])
@pytest.mark.parametrize("detector", ["efast", "arc_star"])
def test_other_lengths_of_arcs(scene, lengths, detector):
    names = ("shortest_inner", "longest_inner", "shortest_outer", "longest_outer")
    options = CornerOptions(detector=detector, kappa=0.0, **dict(zip(names, lengths, strict=True)))
    events, size = scene.events[:4000].copy(), (scene.width, scene.height)
    events["t"] -= events["t"] % 1_000_000
    found = CornerDetector(*size, options).detect(events)
    assert np.array_equal(found, twin(events, size, options))
    assert found.sum() > 20


@pytest.mark.parametrize(
    ("times", "polarities", "newest"),
    [
        ([0, 50_000_000], [1, 1], 0),  # exactly kappa later is still repeated
        ([0, 50_000_001], [1, 1], 1),
        ([0, 40_000_000, 80_000_000], [1, 1, 1], 0),  # left out, it still counts as the latest
        ([0, 1, 2], [1, 0, 1], 2),  # the other polarity was in between
        ([0, 0, 1], [1, 0, 1], 0),  # or not: at the same time is not in between
    ],
)
def test_arc_star_leaves_out_repeated_events(times, polarities, newest):
    n = len(times)
    events = make_events(np.full(n, 4), np.full(n, 4), np.array(polarities), np.array(times))
    for kappa, last in ((50.0, newest), (0.0, n - 1)):
        detector = ArcStarDetector(9, 9, CornerOptions(detector="arc_star", kappa=kappa))
        detector.detect(events)
        ranks = np.unique(times, return_inverse=True)[1] + 1
        assert detector._surface.ranks[1, 4, 4] == ranks[last]


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("before_end", [0, 1, 150, 299, 300])
def test_ranks_that_run_out_are_numbered_anew(name, before_end):
    rng = np.random.default_rng(before_end)
    events = random_events(rng, 600, (12, 11), np.cumsum(rng.integers(0, 2, 600)))
    detector = CornerDetector(12, 11, SETTINGS[name])
    surface = detector._detector._surface
    # As if 2^31 times had gone by before this stream.
    surface.clock[0] = INT32_MAX - before_end
    found = np.concatenate([detector.detect(piece) for piece in np.split(events, [100, 100, 200, 201, 450])])
    assert np.array_equal(found, twin(events, (12, 11), SETTINGS[name]))
    assert surface.clock[0] <= INT32_MAX


def test_ranks_numbered_anew_keep_the_newest_time_though_no_pixel_holds_it():
    options = CornerOptions(detector="arc_star")
    detector = ArcStarDetector(9, 9, options)
    detector._surface.clock[0] = INT32_MAX - 2
    one = np.ones(2, int)
    detector.detect(make_events(4 * one, 4 * one, one, np.array([1, 2])))  # the second is left out
    detector.detect(make_events(np.array([5, 6]), 4 * one, one, np.array([2, 2])))
    before, first, second = detector._surface.ranks[1, 4, 4:7]
    assert before < first == second


def test_two_threads_find_the_same(scene, monkeypatch):
    size = (scene.width, scene.height)
    one, two = EfastDetector(*size, CornerOptions()), EfastDetector(*size, CornerOptions(threads=2))
    monkeypatch.setattr(efast, "_FEW", 100)
    for piece in np.array_split(scene.events, 30):
        assert np.array_equal(one.detect(piece), two.detect(piece))
        assert np.array_equal(one.detect(piece[:0]), two.detect(piece[:0]))


def test_arc_star_has_no_second_thread():
    with pytest.raises(OptionError, match=r"corners.threads is 2"):
        check_options(FrontendOptions(corners=CornerOptions(detector="arc_star", threads=2)))


@pytest.mark.parametrize("name", SETTINGS)
def test_time_that_goes_back_is_refused(name):
    events = make_events(np.full(3, 5), np.full(3, 5), np.ones(3), np.array([7, 9, 8]))
    with pytest.raises(FrontendError, match="time goes back at 8 ns"):
        CornerDetector(12, 12, SETTINGS[name]).detect(events)


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


def test_usual_lengths_are_the_defaults():
    o = CornerOptions()
    assert (o.shortest_inner, o.longest_inner, o.shortest_outer, o.longest_outer) == USUAL
