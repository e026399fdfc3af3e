"""An event camera in the manner of iniVation's DAVIS346, 2.3 times its size: 0.14 m high, with a C-mount lens."""

from __future__ import annotations

import numpy as np

from esfo_simulation.objects.mounting import Mounting
from esfo_simulation.render.surface import Model, Mosaic, Surface, circle, facing, plain, rectangle, rounded

_X, _Y, _Z = np.eye(3)
_MOUNTING = Mounting(offset_m=(-0.012, 0.004, -0.003), tilt_deg=(1.5, 2.5), scale=2.3)
_CASE, _METAL, _PRINT = 0.1, 0.65, 0.92
# Half the size along the viewing direction, across and upwards.
_HALF = np.array([0.0125, 0.02, 0.03])

_TEXT = Mosaic((8, 1), _CASE, (_PRINT,), cover=1.0, inset=(0.05, 0.35))
_SERIAL = Mosaic((6, 4), 0.88, (0.05, 0.1, 0.2), cover=0.8, inset=(0.08, 0.3))
_SPECKS = Mosaic((4, 6), _CASE, (0.05, 0.22, 0.32), cover=0.45, inset=(0.2, 0.4))
_FINS = Mosaic((1, 6), 0.32, (0.03,), cover=1.0, inset=(0.1, 0.2))
_KNURL = Mosaic((1, 1), 0.26, (0.05,), cover=1.0, inset=(0.08, 0.2))
_SCALE = Mosaic((2, 1), 0.09, (0.7, 0.9), cover=0.5, inset=(0.15, 0.35))


def camera(seed: int) -> Model:
    """Return the camera looking along x, upright (z), its lens included.

    The case stands 12 mm behind and 4 mm beside the spin axis, 3 mm low, and is tilted by 2.9 degrees: far from any
    symmetry about z by its lens. `seed` draws the specks of the case, its print and the engraving of the lens. Metres.
    """
    surface = Surface(np.random.default_rng(seed))
    _case(surface)
    _lens(surface.placed([_HALF[0], 0, 0.004], facing(_X)))
    _front(surface.placed([_HALF[0], 0, 0], facing(_X)))
    _rear(surface.placed([-_HALF[0], 0, 0], facing(-_X)))
    for side in (-1.0, 1.0):
        _flank(surface.placed([0, side * _HALF[1], 0], facing(side * _Y)), side)
    _top(surface.placed([0, 0, _HALF[2]], facing(_Z, _X)))
    _foot(surface.placed([0, 0, -_HALF[2]], facing(-_Z, _X)))
    return _MOUNTING.place(surface.build())


def _case(surface: Surface) -> None:
    """Add the middle part with its bevels, and the two plates that close it."""
    x, y, z = _HALF
    middle = surface.placed([0, 0, 0], facing(_X))
    middle.extrude(rounded(2 * y, 2 * z, [0.003] * 4, 4), -x, x, [plain(_CASE)])
    for low, high in ((x - 0.002, x - 0.0014), (-x + 0.0014, -x + 0.002)):
        middle.extrude(rounded(2 * y + 6e-4, 2 * z + 6e-4, [0.003] * 4, 4), low, high, [plain(0.4)])


def _lens(surface: Surface) -> None:
    """Add mount ring, focus and aperture rings with their knurls and scales, and the glass."""
    rings = [
        ((0.0155, 0.0), (0.0155, 0.004), plain(_METAL)),
        ((0.0135, 0.004), (0.0135, 0.007), _SCALE),
        ((0.0150, 0.007), (0.0150, 0.014), _KNURL),
        ((0.0138, 0.014), (0.0138, 0.019), _SCALE),
        ((0.0152, 0.019), (0.0152, 0.025), _KNURL),
        ((0.0140, 0.025), (0.0165, 0.033), plain(0.12)),
    ]
    for low, high, mosaic in rings:
        surface.revolve([low, high], 20, [mosaic])
    surface.decal(circle(0.0160, 20), 0.07, 0.0332)
    ring = surface.placed([0, 0, 0.0334])
    for k in range(14):
        if k not in (3, 4, 9):
            angle = 2 * np.pi * k / 14
            R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            ring.decal((rectangle(0.0016, 0.0030, (0.0140, 0))) @ R.T, _PRINT, 0.0)
    for radius, albedo, height in (
        (0.0115, 0.35, 0.0),
        (0.0108, 0.03, 1e-4),
        (0.006, 0.09, 2e-4),
        (0.0045, 0.02, 3e-4),
    ):
        ring.decal(circle(radius, 20), albedo, height)
    ring.decal(rectangle(0.003, 0.002, (-0.004, 0.005)) @ np.array([[0.9, 0.3], [-0.3, 0.9]]), 0.8, 4e-4)


def _screws(surface: Surface, x: float, y: float) -> None:
    for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        surface.decal(circle(0.0019, 10, (sx * x, sy * y)), _METAL)
        surface.decal(circle(0.0010, 6, (sx * x, sy * y)), 0.03, 3e-4)


def _front(surface: Surface) -> None:
    _screws(surface, 0.0165, 0.0265)
    surface.panel(0.022, 0.0038, _TEXT, (-0.003, -0.0195))
    surface.panel(0.014, 0.0022, _TEXT, (-0.006, -0.0245))
    surface.decal(circle(0.0012, 8, (0.011, -0.024)), 0.95)


def _rear(surface: Surface) -> None:
    """Add the USB socket, two round sockets for synchronisation, the cooling slots and the serial number."""
    _screws(surface, 0.0165, 0.0265)
    surface.placed([0.004, -0.019, 0]).extrude(rectangle(0.0145, 0.0065), 0.0, 0.0015, [plain(_METAL)])
    surface.decal(rectangle(0.0125, 0.0045, (0.004, -0.019)), 0.02, 0.0017)
    surface.decal(rectangle(0.0100, 0.0014, (0.004, -0.019)), 0.5, 0.0019)
    for x in (-0.007, 0.006):
        socket = surface.placed([x, -0.006, 0])
        socket.revolve([(0.0046, 0), (0.0046, 0.003), (0.0040, 0.004)], 14, [plain(_METAL), plain(0.4)])
        socket.decal(circle(0.0034, 12), 0.03, 0.0042)
        for px, py in circle(0.002, 4, (0.0, 0.0)):
            socket.decal(rectangle(0.001, 0.001, (px, py)), 0.85, 0.0044)
    surface.panel(0.026, 0.016, _SERIAL, (0.002, 0.011))
    surface.decal(circle(0.0012, 8, (-0.012, -0.0185)), 0.95)


def _flank(surface: Surface, side: float) -> None:
    """Add the maker's sign on one side, specks on both, and two mounting holes."""
    if side > 0:
        sign = surface.placed([0.0, 0.008, 0])
        for radius, albedo, height in ((0.009, _PRINT, 2e-4), (0.0068, _CASE, 3e-4), (0.0040, _PRINT, 4e-4)):
            sign.decal(circle(radius, 16), albedo, height)
        sign.decal(rectangle(0.010, 0.0024, (0.0045, 0.0)), _CASE, 5e-4)
        surface.panel(0.02, 0.004, _TEXT, (0, -0.008))
        surface.panel(0.02, 0.01, _SPECKS, (0, -0.018))
    else:
        surface.panel(0.02, 0.034, _SPECKS, (0, 0.004))
        surface.panel(0.014, 0.006, _SERIAL, (0.001, -0.021))
    for y in (0.0255, -0.0265):
        surface.decal(circle(0.0021, 10, (0.007, y)), 0.5)
        surface.decal(circle(0.0014, 10, (0.007, y)), 0.02, 3e-4)


def _top(surface: Surface) -> None:
    surface.panel(0.028, 0.018, _FINS, (-0.003, 0))
    surface.decal(circle(0.0021, 10, (0.0155, 0.005)), 0.5)
    surface.decal(circle(0.0014, 10, (0.0155, 0.005)), 0.02, 3e-4)


def _foot(surface: Surface) -> None:
    """Add the plate with the tripod thread, on which the camera stands."""
    surface.extrude(rectangle(0.026, 0.02), 0.0, 0.004, [plain(0.45)])
    surface.revolve([(0.0035, 0.004), (0.0035, 0.0075)], 10, [plain(0.7)])
