"""A relay satellite of the first TDRS generation, about 0.33 m from wing tip to wing tip (1:53)."""

from __future__ import annotations

import numpy as np

from esfo_core.orbit import rotation
from esfo_simulation.objects.mounting import Mounting
from esfo_simulation.objects.solar_wing import SolarWing
from esfo_simulation.render.surface import Model, Mosaic, Surface, circle, facing, plain

_X, _Y, _Z = np.eye(3)
_MOUNTING = Mounting(offset_m=(-0.003, 0.004, 0.002), tilt_deg=(-2.0, 1.8))

_BUS = Mosaic((3, 3), 0.5, (0.15, 0.3, 0.75, 0.9), cover=0.85, inset=(0.08, 0.28))
_CELLS = Mosaic((4, 5), 0.6, (0.05, 0.07, 0.1, 0.14), cover=0.97, raised=2e-4, inset=(0.03, 0.14))
_BACK = Mosaic((2, 3), 0.14, (0.45, 0.6, 0.8), cover=0.65, inset=(0.1, 0.35))
_WING = SolarWing(3, 0.028, 0.064, 0.002, 0.073, _CELLS, _BACK)
_MESH = Mosaic((1, 1), 0.85, (0.2, 0.26, 0.33, 0.4), cover=0.95, inset=(0.04, 0.12))
_MESH_BACK = Mosaic((1, 1), 0.6, (0.1, 0.14, 0.2), cover=0.95, inset=(0.05, 0.15))
_BOX = Mosaic((2, 2), 0.3, (0.1, 0.7, 0.9), cover=0.7, inset=(0.1, 0.3))


def tdrs(seed: int) -> Model:
    """Return the satellite with the earth-facing side up (z), single-access dishes along x and solar wings along y.

    It stands 5 mm beside the spin axis, 2 mm high and tilted by 2.7 degrees. The outline nearly repeats after half a
    turn: the wings are set 8 degrees apart, the dishes point to opposite sides but for some 10 degrees. Cells on one
    face of the wings, ground-link dish, omni mast and surface pattern tell the halves apart. `seed` draws the pattern.
    Metres.
    """
    surface = Surface(np.random.default_rng(seed))
    surface.revolve([(0.034, -0.032), (0.034, 0.03)], 6, [_BUS])
    _multiple_access_array(surface.placed([0, 0, 0.03]))
    _single_access_antenna(surface, side=1.0, aim=(0.30, -0.62, 0.72))
    _single_access_antenna(surface, side=-1.0, aim=(-0.20, 0.56, 0.80))
    for side, setting in ((1.0, 3.0), (-1.0, 11.0)):
        wing = surface.placed([0, 0, -0.008], rotation(_Y, float(np.radians(setting))))
        wing.rod([0, side * 0.028, 0], [0, side * 0.073, 0], 0.002, 0.7)
        _WING.add(wing, side)
    _other_antennas(surface)
    return _MOUNTING.place(surface.build())


def _multiple_access_array(surface: Surface) -> None:
    """Add the hexagonal plate with its 30 helices."""
    surface.extrude(circle(0.037, 6), 0.0, 0.003, [plain(0.75)])
    pitch = 0.0105
    rows = [(row, k - (n - 1) / 2) for row, n in zip(range(-3, 3), (4, 5, 6, 6, 5, 4), strict=True) for k in range(n)]
    for row, column in rows:
        helix = surface.placed([pitch * column, pitch * 0.866 * (row + 0.5), 0.003])
        helix.revolve([(0.0034, 0.0), (0.0030, 0.012)], 5, [plain(0.12)])
        helix.decal(circle(0.002, 5), 0.85, 0.0122)


def _single_access_antenna(surface: Surface, side: float, aim: tuple[float, float, float]) -> None:
    """Add an umbrella of 18 ribs and its feed on a tripod, at the end of an arm."""
    hub = np.array([side * 0.102, 0, 0.008])
    surface.rod([side * 0.03, 0, 0.004], hub, 0.0028, 0.7)
    surface.box([side * 0.06, 0, 0.006], np.diag([0.007, 0.006, 0.006]), _BOX)
    dish = surface.placed(hub, facing(aim))
    dish.box([0, 0, -0.004], np.diag([0.009, 0.009, 0.006]), _BOX)
    radius, focus = 0.052, 0.036
    bowl = [(r * radius, (r * radius) ** 2 / (4 * focus)) for r in (0.0, 0.22, 0.5, 0.77, 1.0)]
    back = [(r, z - 0.0015) for r, z in bowl]
    dish.revolve([*back, *bowl[::-1]], 18, [*[_MESH_BACK] * 4, plain(0.9), *[_MESH] * 3, plain(0.5)])
    dish.revolve([(0.006, focus - 0.006), (0.009, focus), (0.005, focus + 0.008)], 8, [plain(0.9), plain(0.2)])
    for x, y in circle(0.6 * radius, 3):
        dish.rod([x, y, (0.6 * radius) ** 2 / (4 * focus)], [0.1 * x, 0.1 * y, focus], 0.0011, 0.9)


def _other_antennas(surface: Surface) -> None:
    """Add the dish of the ground link, the omni mast, and boxes under the bus."""
    surface.rod([0.018, 0.018, -0.03], [0.05, 0.045, -0.045], 0.002, 0.6)
    dish = surface.placed([0.05, 0.045, -0.045], facing([0.5, 0.6, 0.3]))
    bowl = [plain(0.25), plain(0.8), Mosaic((1, 1), 0.9, (0.55, 0.7), inset=(0.05, 0.3))]
    dish.revolve([(0.0, -0.002), (0.021, 0.006), (0.021, 0.007), (0.0, 0.0)], 14, bowl)
    dish.rod([0, 0, 0], [0, 0, 0.014], 0.002, 0.12)
    mast = surface.placed([-0.02, 0.024, 0.03])
    mast.revolve([(0.0025, 0), (0.0015, 0.05), (0.005, 0.053), (0.005, 0.06)], 8, [plain(0.8), plain(0.2), plain(0.1)])
    surface.box([-0.01, -0.008, -0.042], np.diag([0.014, 0.016, 0.01]), _BOX)
    surface.box([0.016, 0.004, -0.039], np.diag([0.008, 0.01, 0.007]), _BOX)
    nozzle = surface.placed([-0.01, 0.018, -0.032], facing(-_Z))
    nozzle.revolve([(0.004, 0), (0.009, 0.016)], 10, [plain(0.35)])
    nozzle.decal(circle(0.0075, 10), 0.04, 0.0162)
