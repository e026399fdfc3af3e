"""A space telescope in the manner of Hubble, about 0.3 m long, as a model of it would stand on a turntable."""

from __future__ import annotations

import numpy as np

from esfo_core.orbit import rotation
from esfo_simulation.objects.mounting import Mounting
from esfo_simulation.render.surface import Model, Mosaic, Points, Surface, facing

_X, _Y, _Z = np.eye(3)
_MOUNTING = Mounting(offset_m=(0.003, -0.002, 0.003), tilt_deg=(1.2, -1.6))
_TUBE_SIDES = 10
_FOIL = Mosaic(cells=(1, 5), base=0.5, palette=(0.12, 0.18, 0.9, 0.95))
_SHROUD = Mosaic(cells=(1, 4), base=0.42, palette=(0.1, 0.15, 0.85, 0.95))
_CELLS = Mosaic(cells=(3, 8), base=0.75, palette=(0.12, 0.18, 0.25, 0.35), cover=0.93)
_BACK = Mosaic(cells=(2, 7), base=0.3, palette=(0.1, 0.7, 0.85, 0.95), cover=0.8)
_DOOR = Mosaic(cells=(3, 3), base=0.6, palette=(0.12, 0.2, 0.95))
_EQUIPMENT = Mosaic(cells=(2, 2), base=0.65, palette=(0.1, 0.15, 0.25), cover=0.7)
_PLAIN = Mosaic(cells=(1, 1), base=0.35, palette=(0.35,), cover=0.0)


def hubble(seed: int) -> Model:
    """Return the telescope with its tube along z, aperture up, and the booms of the panels along x.

    It stands 4 mm beside the spin axis, 3 mm high and tilted by 2 degrees. The tube with its two diameters, an open
    aperture door, two unequally tilted solar panels, a dish on one side and a box on the other: no rotation about z
    maps it to itself. `seed` draws the surface pattern. Metres.
    """
    surface = Surface(np.random.default_rng(seed))
    _tube(surface)
    _solar_panel(surface, side=1.0, tilt=np.radians(24))
    _solar_panel(surface, side=-1.0, tilt=np.radians(-13))
    _antenna(surface)
    _equipment(surface)
    return _MOUNTING.place(surface.build())


def _tube(surface: Surface) -> None:
    shell = surface.prism(0.050, -0.02, 0.125, _TUBE_SIDES, _FOIL)
    shroud = surface.prism(0.064, -0.135, -0.02, _TUBE_SIDES, _SHROUD)

    def ring(rim: Points, z: float) -> Points:
        return np.column_stack([rim, np.full(len(rim), z)])

    surface.cone(np.array([0, 0, -0.02]), ring(shroud, -0.02), (0.8, 0.2, 0.55))
    surface.cone(np.array([0, 0, -0.135]), ring(shroud, -0.135)[::-1], (0.7, 0.15, 0.45))
    # A shallow funnel stands for the dark aperture, with a bright rim.
    surface.cone(np.array([0, 0, 0.125]), ring(shell, 0.125), (0.85, 0.6))
    surface.cone(np.array([0, 0, 0.1255]), ring(0.8 * shell, 0.1255), (0.1, 0.16))
    lift = rotation(_Y, np.radians(-62))
    u, v, n = lift @ (0.036 * _X), 0.036 * _Y, lift @ (0.002 * _Z)
    surface.box(np.array([0.05, 0, 0.125]) + u, np.stack([u, v, n]), _DOOR)


def _solar_panel(surface: Surface, side: float, tilt: float) -> None:
    turn = rotation(_X, tilt)
    surface.box(np.array([side * 0.072, 0, 0.01]), np.diag([0.024, 0.003, 0.003]), _PLAIN)
    width, length, half_thickness = 0.066, 0.21, 0.0015
    middle = np.array([side * 0.125, 0, 0.0])
    surface.box(middle, np.diag([width / 2, half_thickness, length / 2]) @ turn.T, _PLAIN)
    for normal, mosaic in ((turn @ _Y, _CELLS), (turn @ -_Y, _BACK)):
        face = surface.placed(middle + (half_thickness + 2e-4) * normal, facing(normal))
        face.panel(width, length, mosaic, z=0.0)


def _antenna(surface: Surface) -> None:
    surface.box(np.array([0, 0.085, 0.055]), np.diag([0.0025, 0.036, 0.0025]), _PLAIN)
    angle = 2 * np.pi * np.arange(8) / 8
    aim = rotation(_X, np.radians(-50)) @ rotation(_Y, np.radians(20))
    rim = np.column_stack([0.03 * np.cos(angle), 0.03 * np.sin(angle), np.full(8, 0.012)]) @ aim.T
    center = np.array([0, 0.125, 0.055])
    surface.cone(center, center + rim, (0.9, 0.2))
    surface.cone(center - aim @ (0.001 * _Z), (center + rim)[::-1], (0.6, 0.15))


def _equipment(surface: Surface) -> None:
    for azimuth, z, depth in ((-90, 0.06, 0.022), (-60, -0.09, 0.014), (30, -0.06, 0.012), (140, -0.1, 0.016)):
        turn = rotation(_Z, np.radians(azimuth))
        reach = (0.048 if z > 0 else 0.061) + depth
        surface.box(turn @ np.array([reach, 0, z]), np.diag([depth, 0.017, 0.02]) @ turn.T, _EQUIPMENT)
