"""The picture of events and axis."""

import numpy as np
import pytest

from esfo_core.camera import Camera
from esfo_core.events import make_events
from esfo_core.orbit import Spin
from esfo_frontend.overlay import BACKGROUND, COLOURS, LINE, Overlay, draw_line, screw_line


def line_pixels(line, width=40, height=30):
    picture = np.zeros((height, width, 3), np.uint8)
    draw_line(picture, np.array(line, float))
    return {(int(x), int(y)) for y, x in zip(*np.nonzero((picture == LINE).all(axis=2)), strict=True)}


def test_events_are_drawn_in_their_colours():
    overlay = Overlay(8, 6)
    overlay.add(make_events([1, 7, 3, 3], [2, 5, 0, 0], [0, 1, 0, 1], [0, 1, 2, 3]))
    picture = overlay.picture(np.empty((0, 2)))
    assert picture.shape == (6, 8, 3)
    assert tuple(picture[2, 1]) == tuple(COLOURS[0])
    assert tuple(picture[5, 7]) == tuple(COLOURS[1])
    assert tuple(picture[0, 3]) == tuple(COLOURS[1])
    assert tuple(picture[0, 0]) == BACKGROUND
    assert overlay.events == 4


@pytest.mark.parametrize("end", [(30, 12), (12, 25), (5, 3), (10, 20)])
def test_a_line_covers_the_pixels_along_it(end):
    start = np.array([10.0, 12.0])
    found = line_pixels([start, end])
    for s in np.linspace(0, 1, 101):
        x, y = np.rint(start + s * (np.array(end) - start)).astype(int)
        assert (x, y) in found
    normal = np.array([end[1] - start[1], start[0] - end[0]]) / np.hypot(*(np.array(end) - start))
    assert max(abs((np.array(p) - start) @ normal) for p in found) < 2


def test_only_the_visible_part_of_a_far_line_is_drawn():
    inside = line_pixels([(0, 15), (39, 15)])
    assert line_pixels([(-1e7, 15), (1e7, 15)]) == inside
    assert line_pixels([(-1e7, 45), (1e7, 45)]) == set()
    assert line_pixels([(50, -1e6), (50, 1e6)]) == set()


def test_the_screw_line_passes_through_the_projected_centre():
    camera = Camera.pinhole(200, 100, 150.0)
    spin = Spin(np.array([0.6, 0.8, 0.0]), 1.0, np.array([0.1, 0.05, 1.0]), 0)
    line = screw_line(spin, camera)
    centre = camera.project(spin.center[None])[0]
    direction = line[-1] - line[0]
    off = (line - centre) @ (np.array([-direction[1], direction[0]]) / np.linalg.norm(direction))
    assert np.abs(off).max() < 1e-9
    assert screw_line(None, camera).shape == screw_line(spin, None).shape == (0, 2)
