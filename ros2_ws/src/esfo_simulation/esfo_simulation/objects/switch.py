"""A hand-held console in the manner of the Nintendo Switch, about 0.24 m wide (full size), standing upright."""

from __future__ import annotations

import numpy as np

from esfo_simulation.objects.mounting import Mounting
from esfo_simulation.render.surface import Model, Mosaic, Surface, circle, facing, plain, rectangle, rounded

_X, _Y, _Z = np.eye(3)
_MOUNTING = Mounting(offset_m=(-0.004, 0.003, 0.004), tilt_deg=(-6.0, -2.0))
_HALF_DEPTH = 0.007
_TABLET, _KEY, _PRINT, _LEFT, _RIGHT = 0.1, 0.05, 0.9, 0.55, 0.36

_PICTURE = Mosaic((8, 5), 0.45, (0.08, 0.15, 0.25, 0.7, 0.85, 0.95), cover=0.9, inset=(0.05, 0.3))
_GAME = Mosaic((3, 2), 0.8, (0.1, 0.2, 0.4), cover=0.8, inset=(0.1, 0.3))
_LABEL = Mosaic((7, 3), 0.85, (0.06, 0.1, 0.2), cover=0.8, inset=(0.08, 0.3))
_SCUFFS = Mosaic((2, 6), _TABLET, (0.04, 0.2, 0.3), cover=0.5, inset=(0.2, 0.42))
_VENT = Mosaic((14, 1), 0.3, (0.02,), cover=1.0, inset=(0.12, 0.2))
_KNURL = Mosaic((1, 1), 0.2, (0.05, 0.08), cover=0.9, inset=(0.1, 0.25))


def switch(seed: int) -> Model:
    """Return the console with the screen looking along -y and the shoulder keys up (z).

    It stands 5 mm beside the spin axis, 4 mm high, and leans back by 6 degrees. The outline repeats after half a turn;
    the two controllers differ in albedo and in the order of stick and keys, screen and back in everything. `seed` draws
    the picture on the screen, scuffs and print. Metres.
    """
    surface = Surface(np.random.default_rng(seed))
    # The body's own coordinates: x to the right of the player, y up, z out of the screen.
    body = surface.placed([0, 0, 0], facing(-_Y))
    body.extrude(rectangle(0.173, 0.102), -_HALF_DEPTH, _HALF_DEPTH, [plain(_TABLET)])
    _screen(body.placed([0, 0, _HALF_DEPTH]))
    _controller(body.placed([-0.1035, 0, 0]), _LEFT, side=-1.0)
    _controller(body.placed([0.1035, 0, 0]), _RIGHT, side=1.0)
    _edges(body)
    _back(body.placed([0, 0, -_HALF_DEPTH], facing(-_Z, _Y)))
    return _MOUNTING.place(surface.build())


def _screen(surface: Surface) -> None:
    surface.decal(rectangle(0.166, 0.094), 0.03)
    surface.panel(0.138, 0.078, _PICTURE, (0, 0), 4e-4)


def _controller(surface: Surface, albedo: float, side: float) -> None:
    """Add one controller, round on its outer side; the left one has the stick above the keys, the right one below."""
    outer, inner = 0.030, 0.001
    radii = [outer, inner, inner, outer] if side < 0 else [inner, outer, outer, inner]
    outline = rounded(0.034, 0.102, radii, 7)
    rings = [(0.94, -_HALF_DEPTH), (1.0, -0.004), (1.0, 0.004), (0.94, _HALF_DEPTH)]
    shift = np.array([-side * 0.017, 0.0])  # the flat side stays where it is
    shell = [np.insert(shift + share * (outline - shift), 2, z, axis=1) for share, z in rings]
    surface.loft(np.array(shell), [plain(albedo)])
    surface.box([-side * 0.0172, 0, 0], np.diag([0.0006, 0.051, 0.0072]), plain(0.75))
    face = surface.placed([side * 0.001, 0, _HALF_DEPTH])
    _stick(face.placed([0, -side * 0.026 + 0.008, 0]))
    _keys(face.placed([0, side * 0.022 + 0.008, 0]))
    sign = face.placed([-side * 0.008, 0.0435, 0])
    sign.decal(rectangle(0.007, 0.0022), _KEY)
    if side > 0:
        sign.decal(rectangle(0.0022, 0.007), _KEY, 3e-4)
        face.placed([-0.003, -0.040, 0]).revolve([(0.0042, 0), (0.0042, 0.001)], 12, [plain(0.75)])
    else:
        face.placed([0.003, -0.034, 0]).extrude(rectangle(0.007, 0.007), 0, 0.001, [plain(_KEY)])
        face.decal(circle(0.0022, 10, (0.003, -0.034)), 0.6, 0.0012)


def _stick(surface: Surface) -> None:
    surface.revolve([(0.0115, -0.001), (0.0115, 0.0008)], 18, [plain(0.08)])
    surface.decal(circle(0.0098, 18), 0.28, 0.001)
    surface.revolve([(0.005, 0.001), (0.0045, 0.005)], 10, [plain(0.06)])
    cap = [(0.005, 0.0045), (0.0085, 0.0055), (0.0085, 0.0085), (0.0068, 0.0095), (0.0, 0.0085)]
    surface.revolve(cap, 18, [plain(0.06), _KNURL, plain(0.32), plain(0.08)])


def _keys(surface: Surface) -> None:
    """Add four round keys with a mark each: bars that differ in number and direction."""
    for k, (x, y) in enumerate(((0, 0.0092), (0.0092, 0), (0, -0.0092), (-0.0092, 0))):
        key = surface.placed([x, y, 0])
        key.revolve([(0.0041, -0.001), (0.0041, 0.0015), (0.0036, 0.002)], 14, [plain(_KEY)])
        wide, high = (0.0044, 0.0012) if k % 2 else (0.0012, 0.0044)
        key.decal(rectangle(wide, high), _PRINT, 0.0022)
        key.decal(rectangle(0.003, 0.0012, (0.0, -0.0012 + 0.0008 * k)), _PRINT, 0.0023)


def _edges(body: Surface) -> None:
    """Add shoulder keys and triggers, and what the upper and lower edges of the tablet carry."""
    for side, width in ((-1.0, 0.026), (1.0, 0.026)):
        body.box([side * 0.1, 0.0505, 0.002], np.diag([width / 2, 0.0022, 0.0035]), plain(0.15))
        body.box([side * 0.1, 0.047, -0.009], np.diag([width / 2, 0.0045, 0.0035]), plain(0.12))
    upper = body.placed([0, 0.051, 0], facing(_Y, -_Z))
    lower = body.placed([0, -0.051, 0], facing(-_Y, _Z))
    for edge, x, width, mosaic in (
        (upper, 0.0, 0.05, _VENT),
        (upper, 0.052, 0.03, _GAME),
        (lower, 0.02, 0.03, _VENT),
        (lower, -0.03, 0.012, _GAME),
    ):
        edge.panel(width, 0.0075, mosaic, (x, 0))
    upper.placed([-0.068, 0, 0]).revolve([(0.003, 0), (0.003, 0.001)], 10, [plain(0.7)])
    upper.placed([-0.05, 0, 0]).extrude(rectangle(0.016, 0.003), 0, 0.0008, [plain(0.5)])


def _back(surface: Surface) -> None:
    """Add the stand on one side, the vents, logo and labels; x runs from the right controller to the left one."""
    surface.placed([0.068, -0.006, 0]).extrude(rectangle(0.016, 0.07), 0.0, 0.0012, [plain(0.22)])
    surface.decal(rectangle(0.008, 0.003, (0.068, -0.036)), 0.6, 0.0014)
    for center, (width, height), mosaic in (
        ((0.0, 0.043), (0.12, 0.006), _VENT),
        ((-0.05, -0.04), (0.04, 0.012), _LABEL),
        ((0.03, -0.018), (0.036, 0.044), _SCUFFS),
        ((-0.058, 0.012), (0.03, 0.05), _SCUFFS),
    ):
        surface.panel(width, height, mosaic, center)
    # The logo: two controllers side by side, one outlined and one full.
    logo = surface.placed([-0.008, 0.004, 0.0])
    logo.decal(rounded(0.014, 0.03, [0.006, 0.001, 0.001, 0.006], center=(-0.009, 0)), _PRINT, 3e-4)
    logo.decal(rounded(0.009, 0.025, [0.004, 0.001, 0.001, 0.004], center=(-0.009, 0)), _TABLET, 4e-4)
    logo.decal(circle(0.0026, 10, (-0.009, 0.006)), _PRINT, 5e-4)
    logo.decal(rounded(0.014, 0.03, [0.001, 0.006, 0.006, 0.001], center=(0.009, 0)), _PRINT, 3e-4)
    logo.decal(circle(0.0026, 10, (0.0095, -0.002)), _TABLET, 5e-4)
    for x in (-0.103, 0.103):
        for y in (-0.035, 0.035):
            surface.decal(circle(0.0022, 8, (x, y)), 0.8)
            surface.decal(rectangle(0.003, 0.0008, (x, y)), 0.05, 3e-4)
        surface.panel(0.014, 0.028, _LABEL, (x, 0.0), 3e-4)
