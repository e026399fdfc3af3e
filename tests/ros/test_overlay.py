"""The picture of events, tracks and axis."""

from itertools import pairwise

import numpy as np
import pytest

from esfo_core.camera import Camera
from esfo_core.events import make_events
from esfo_core.orbit import Spin
from esfo_core.tracks import Tracks
from esfo_frontend.overlay import (
    BACKGROUND,
    COLOURS,
    HEAD,
    LINE,
    TRAIL,
    TRAIL_NS,
    Overlay,
    draw_tracks,
    line_pixels,
    screw_line,
)

NO_LINE = np.empty((0, 2))


def pixels_of(line, width=40, height=30):
    found = line_pixels(np.array(line, float), width, height)
    assert found.min(initial=0) >= 0
    assert (found < [width, height]).all()
    return set(map(tuple, found.tolist()))


def test_events_are_drawn_in_their_colours():
    overlay = Overlay(8, 6)
    overlay.add(make_events([1, 7, 3, 3], [2, 5, 0, 0], [0, 1, 0, 1], [0, 1, 2, 3]))
    picture = overlay.picture(NO_LINE)
    assert picture.shape == (6, 8, 3)
    assert tuple(picture[2, 1]) == tuple(COLOURS[0])
    assert tuple(picture[5, 7]) == tuple(COLOURS[1])
    assert tuple(picture[0, 3]) == tuple(COLOURS[1])
    assert tuple(picture[0, 0]) == BACKGROUND
    assert of_colour(overlay.picture(np.array([(0.0, 3.0), (9.0, 3.0)])), LINE) == {
        (x, y) for x in range(8) for y in (3, 4)
    }
    assert overlay.events == 4


def rows_of(*tracks):
    """Rows of tracks 5, 6, ... at 0, 10, 20, ... ms."""
    return Tracks.concatenate(
        Tracks.from_columns(np.full(len(uv), 5 + k), 10_000_000 * np.arange(len(uv)), uv, np.ones(len(uv)))
        for k, uv in enumerate(tracks)
    )


def of_colour(picture, colour):
    return {(int(x), int(y)) for y, x in zip(*np.nonzero((picture == colour).all(axis=2)), strict=True)}


def test_tracks_are_lines_that_end_in_squares():
    tracks = [(5.2, 4.0), (15.0, 12.4), (30.3, 12.0)], [(3.0, 25.0), (3.0, 25.0)], [(20.0, 20.0)]
    picture = np.zeros((30, 40, 3), np.uint8)
    draw_tracks(picture, rows_of(*tracks))
    heads = {(x + i, y + j) for x, y in ((30, 12), (3, 25), (20, 20)) for i in (-1, 0, 1) for j in (-1, 0, 1)}
    assert of_colour(picture, HEAD) == heads
    trail = of_colour(picture, TRAIL)
    way = tracks[0]
    along = {
        tuple(np.rint(np.array(a) + s * (np.array(b) - np.array(a))).astype(int).tolist())
        for a, b in pairwise(way)
        for s in np.linspace(0, 1, 500)
    }
    nearest = [min(np.hypot(x - u, y - v) for u, v in along) for x, y in trail]
    assert max(nearest) <= 1.0
    assert all(min(max(abs(x - u), abs(y - v)) for u, v in trail | heads) <= 1 for x, y in along)  # without a gap
    shuffled = np.zeros_like(picture)
    order = np.random.default_rng(1).permutation(6)
    draw_tracks(shuffled, rows_of(*tracks).select(order))
    assert (shuffled == picture).all()


def test_tracks_outside_are_cut_off():
    picture = np.zeros((30, 40, 3), np.uint8)
    draw_tracks(picture, rows_of([(-9.0, 5.0), (60.0, 5.0)], [(10.0, -3.0), (10.0, 2.0)]))
    assert of_colour(picture, TRAIL) == {(x, 5) for x in range(40)} | {(10, 0)}
    assert of_colour(picture, HEAD) == {(x, y) for x in (9, 10, 11) for y in (1, 2, 3)}
    draw_tracks(picture, Tracks.empty())


def test_tracks_are_seen_for_a_while_and_go_on_in_the_next_picture():
    way = np.stack([np.arange(40.0), np.full(40, 15.0)], axis=1)
    rows = rows_of(way)
    first = Overlay(40, 30)
    first.add_tracks(rows.select(np.arange(25)))
    second = Overlay(40, 30, before=first)
    second.add_tracks(rows.select(np.arange(25, 30)))
    picture = second.picture(NO_LINE)
    shown = {x for x, y in of_colour(picture, TRAIL) | of_colour(picture, HEAD) if y == 15}
    assert shown == set(range(29 - TRAIL_NS // 10_000_000 + 1, 31))
    assert second.events == 0
    assert len(Overlay(40, 30).trails()) == 0


def test_when_time_goes_back_the_tracks_begin_anew():
    late = rows_of([(5.0, 5.0), (9.0, 5.0)])
    early = rows_of([(20.0, 20.0), (25.0, 20.0)])
    late.t[:] += 2 * TRAIL_NS
    overlay = Overlay(40, 30)
    overlay.add_tracks(late)
    overlay.add_tracks(early)
    assert overlay.trails().uv.tolist() == early.uv.tolist()
    overlay.add_tracks(late)
    assert overlay.trails().uv.tolist() == late.uv.tolist()


@pytest.mark.parametrize("end", [(30, 12), (12, 25), (5, 3), (10, 20)])
def test_a_line_covers_the_pixels_along_it(end):
    start = np.array([10.0, 12.0])
    found = pixels_of([start, end])
    for s in np.linspace(0, 1, 101):
        x, y = np.rint(start + s * (np.array(end) - start)).astype(int)
        assert (x, y) in found
    normal = np.array([end[1] - start[1], start[0] - end[0]]) / np.hypot(*(np.array(end) - start))
    assert max(abs((np.array(p) - start) @ normal) for p in found) < 2


def test_only_the_visible_part_of_a_far_line_is_drawn():
    inside = pixels_of([(0, 15), (39, 15)])
    assert pixels_of([(-1e7, 15), (1e7, 15)]) == inside
    assert pixels_of([(-1e7, 45), (1e7, 45)]) == set()
    assert pixels_of([(50, -1e6), (50, 1e6)]) == set()


def test_the_screw_line_passes_through_the_projected_centre():
    camera = Camera.pinhole(200, 100, 150.0)
    spin = Spin(np.array([0.6, 0.8, 0.0]), 1.0, np.array([0.1, 0.05, 1.0]), 0)
    line = screw_line(spin, camera)
    centre = camera.project(spin.center[None])[0]
    direction = line[-1] - line[0]
    off = (line - centre) @ (np.array([-direction[1], direction[0]]) / np.linalg.norm(direction))
    assert np.abs(off).max() < 1e-9
    assert screw_line(None, camera).shape == screw_line(spin, None).shape == (0, 2)
