"""The six objects: shape, size, pattern, and how far each is from repeating within a turn."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, maximum_filter
from scipy.spatial import ConvexHull

from esfo_core.camera import Camera
from esfo_core.orbit import rotation
from esfo_simulation.objects.catalogue import OBJECTS
from esfo_simulation.objects.mounting import Mounting
from esfo_simulation.render.renderer import Light, Renderer, Window
from esfo_simulation.render.surface import Model

SIZE_PX, FOCAL_PX, DISTANCE_M = 240, 375.0, 0.85
CAMERA, WINDOW = Camera.pinhole(SIZE_PX, SIZE_PX, FOCAL_PX), Window(0, 0, SIZE_PX, SIZE_PX)
BLUR_PX = 0.65
PHASES_DEG = range(0, 360, 60)
THRESHOLD = 0.3  # of log intensity, that of the simulated sensor
MODELS = {name: make(1) for name, make in OBJECTS.items()}


def look(model, light=Light(), elevation_deg=20.0):  # noqa: B008
    """A function from the phase in degrees to the log radiance, seen from above the horizon with z upright."""
    renderer = Renderer(model, CAMERA, WINDOW, light, BLUR_PX)
    e = np.radians(elevation_deg)
    view = np.array([[1, 0, 0], [0, -np.sin(e), -np.cos(e)], [0, np.cos(e), -np.sin(e)]])

    @cache
    def image(phase_deg):
        R = view @ rotation(np.array([0, 0, 1.0]), np.radians(phase_deg))
        return renderer.levels.log_radiance(renderer.render(R, np.array([0, 0, DISTANCE_M])))

    return image


def silhouette(model):
    """A function from the phase in degrees to the pixels (H, W) that the object covers."""
    image = look(model, Light(background=100.0))
    return lambda phase_deg: image(phase_deg % 360) < 0


def overlap(covers, turn_deg):
    """Intersection over union of the silhouettes before and after a turn, the mean over all phases."""
    pairs = [(covers(phase), covers(phase + turn_deg)) for phase in PHASES_DEG]
    return np.mean([(a & b).sum() / (a | b).sum() for a, b in pairs])


def test_they_are_those_of_the_paper():
    assert set(OBJECTS) == {"hubble", "soho", "tdrs", "dualshock", "switch", "camera"}


@pytest.mark.parametrize("name", OBJECTS)
def test_size_and_place(name):
    model = MODELS[name]
    assert 500 <= len(model.faces) <= 6000
    low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
    assert 0.14 <= (high - low).max() <= 0.36
    # the body is set up about the spin axis, not beside it
    assert (np.abs(low + high) / 2 <= 0.2 * (high - low).max()).all()
    assert ConvexHull(model.vertices).equations[:, 3].max() < 0  # the origin is inside
    assert (model.albedo >= 0.02).all()
    assert (model.albedo <= 0.98).all()
    assert model.faces.dtype == np.int32
    assert np.isfinite(model.normals()).all()


@pytest.mark.parametrize("name", OBJECTS)
def test_the_seed_draws_the_pattern(name):
    first, again, other = MODELS[name], OBJECTS[name](1), OBJECTS[name](2)
    for a, b in zip(parts(first), parts(again), strict=True):
        assert a.tobytes() == b.tobytes()
    changed = look(first)(30) - look(other)(30)
    covered = silhouette(first)(30)
    assert (np.abs(changed[covered]) > THRESHOLD).mean() > 0.02


def parts(model):
    return model.vertices, model.faces, model.albedo


@pytest.mark.parametrize("name", OBJECTS)
def test_faces_look_outwards(name):
    assert share_of_backs(MODELS[name]) < 0.005


def test_a_face_that_looks_inwards_is_found():
    model = MODELS["switch"]
    # the screen's glass, the largest polygon but for the case
    area = np.linalg.norm(
        np.cross(*(model.vertices[model.faces[:, k]] - model.vertices[model.faces[:, 0]] for k in (1, 2))), axis=1
    )
    faces = model.faces.copy()
    faces[np.argsort(area)[-20:]] = faces[np.argsort(area)[-20:], ::-1]
    assert share_of_backs(Model(model.vertices, faces, model.albedo)) > 0.05


def share_of_backs(model):
    """Share of what is seen from all around that is the back of a face: the rims of what is raised over a surface."""
    both = Model(
        model.vertices, np.vstack([model.faces, model.faces[:, ::-1]]), np.repeat([0.3, 0.9], len(model.faces))
    )
    light = Light(ambient=1.0, diffuse=0.0, background=0.1)
    backs = covered = 0
    for elevation in (-60, 15, 70):
        image = look(both, light, elevation)
        for phase in PHASES_DEG:
            radiance = np.exp(image(phase))
            backs += (radiance > 0.4).sum()
            covered += (radiance > 0.2).sum()
    return backs / covered


@pytest.mark.parametrize("name", OBJECTS)
def test_no_part_of_a_turn_brings_it_back(name):
    """Most of what a turn shows differs by an event's threshold from what it showed before."""
    image, covers = look(MODELS[name]), silhouette(MODELS[name])
    for phase, turn_deg in product(PHASES_DEG, (180, 120, 90, 72, 60)):
        before, after = image(phase), image((phase + turn_deg) % 360)
        either = covers(phase) | covers(phase + turn_deg)
        assert (np.abs(after - before)[either] > THRESHOLD).mean() > 0.3
        assert np.corrcoef(before[either], after[either])[0, 1] < 0.9


@pytest.mark.parametrize("name", ["hubble", "soho", "tdrs", "dualshock", "switch"])
def test_the_outline_nearly_repeats_after_half_a_turn(name):
    """As those of the real ones do: it is the surface that tells the halves apart."""
    covers = silhouette(MODELS[name])
    half = overlap(covers, 180)
    assert half > 0.5  # more is shared than not
    assert half > max(overlap(covers, turn) for turn in (120, 90, 72, 60)) + 0.1


@pytest.mark.parametrize("name", OBJECTS)
def test_there_are_corners_to_track(name):
    """Shi and Tomasi's corners in the rendered images, whatever the mesh says."""
    image = look(MODELS[name])
    counts = [corners(image(phase)) for phase in range(0, 360, 20)]
    assert np.median(counts) >= 25
    assert min(counts) >= 8  # the flat ones seen edge-on


def corners(image):
    """Number of maxima of the smaller eigenvalue of the structure tensor that stand for steps of a threshold."""
    dy, dx = np.gradient(image)
    xx, xy, yy = (gaussian_filter(moment, 1.5) for moment in (dx * dx, dx * dy, dy * dy))
    smaller = (xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)
    return ((smaller == maximum_filter(smaller, 5)) & (smaller > step_corner())).sum()


def step_corner():
    """The same measure at the corner of a quadrant one threshold brighter than the rest."""
    quadrant = np.zeros((41, 41))
    quadrant[20:, 20:] = THRESHOLD
    dy, dx = np.gradient(gaussian_filter(quadrant, BLUR_PX))
    xx, xy, yy = (gaussian_filter(moment, 1.5) for moment in (dx * dx, dx * dy, dy * dy))
    return ((xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)).max()


def test_mounting():
    body = Model(np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]], np.int32), np.array([0.5]))
    placed = Mounting((0.1, 0.2, 0.3), (90.0, 0.0), 2.0).place(body)
    np.testing.assert_allclose(placed.vertices, [[0.1, -1.8, 0.3], [2.1, 0.2, 0.3], [0.1, 0.2, 2.3]], atol=1e-15)
    placed = Mounting((0, 0, 0), (90.0, 90.0)).place(body)
    np.testing.assert_allclose(placed.vertices, [[0, -1, 0], [0, 0, -1], [1, 0, 0]], atol=1e-15)
