"""The solar observatory SOHO, about 0.33 m from wing tip to wing tip (1:30)."""

from __future__ import annotations

import numpy as np

from esfo_core.orbit import rotation
from esfo_simulation.objects.mounting import Mounting
from esfo_simulation.objects.solar_wing import SolarWing
from esfo_simulation.render.surface import Model, Mosaic, Surface, circle, facing, plain, rectangle

_X, _Y, _Z = np.eye(3)
_MOUNTING = Mounting(offset_m=(0.004, -0.003, 0.006), tilt_deg=(2.5, -1.5))

_CELLS = Mosaic((3, 6), 0.6, (0.05, 0.07, 0.1, 0.16), cover=0.97, raised=2e-4, inset=(0.03, 0.14))
_BACK = Mosaic((2, 3), 0.16, (0.5, 0.7, 0.85), cover=0.7, inset=(0.1, 0.35))
_WING = SolarWing(3, 0.030, 0.072, 0.002, 0.067, _CELLS, _BACK)
_FOIL = Mosaic((4, 3), 0.5, (0.25, 0.35, 0.7, 0.85, 0.95), cover=0.85, inset=(0.05, 0.25))
_RADIATOR = Mosaic((3, 3), 0.85, (0.12, 0.2, 0.6), cover=0.45, inset=(0.1, 0.35))
_BLANKET = Mosaic((2, 4), 0.75, (0.1, 0.3, 0.5), cover=0.7, inset=(0.1, 0.3))
_DARK = Mosaic((2, 4), 0.12, (0.6, 0.8, 0.4), cover=0.55, inset=(0.15, 0.35))
_SHIELD = Mosaic((6, 6), 0.9, (0.08, 0.15, 0.5), cover=0.35, inset=(0.1, 0.3))


def soho(seed: int) -> Model:
    """Return the observatory with its long axis along z, sunward end up, and the wings along y.

    It stands 5 mm beside the spin axis, 6 mm high and tilted by 2.9 degrees. The outline nearly repeats after half a
    turn: the wings are set 7 degrees apart. Cells on one face of the wings, instruments, dish and surface pattern tell
    the halves apart. `seed` draws the pattern. Metres.
    """
    surface = Surface(np.random.default_rng(seed))
    _service_module(surface)
    _payload_module(surface)
    for side, setting in ((1.0, 7.0), (-1.0, 14.0)):
        wing = surface.placed([0, 0, -0.035], rotation(_Y, float(np.radians(setting))))
        for z in (-0.012, 0.012):
            wing.rod([0, side * 0.052, 0], [0, side * 0.068, z], 0.0014, 0.7)
        _WING.add(wing, side)
    _high_gain_antenna(surface)
    return _MOUNTING.place(surface.build())


def _service_module(surface: Surface) -> None:
    """Propulsion, batteries, radio: the wide lower box, with star tracker and thrusters."""
    surface.box([0, 0, -0.045], np.diag([0.052, 0.052, 0.03]), _FOIL)
    louvre = surface.placed([0.0525, 0.01, -0.045], facing(_X))
    louvre.box([0, 0, 0], np.diag([0.03, 0.02, 0.001]), _RADIATOR)
    radiator = surface.placed([-0.0525, -0.005, -0.045], facing(-_X))
    radiator.box([0, 0, 0], np.diag([0.022, 0.022, 0.0015]), Mosaic((5, 1), 0.15, (0.8, 0.9), 1.0))
    for x, y in ((0.045, 0.045), (-0.045, 0.045), (-0.045, -0.045)):
        nozzle = surface.placed([x, y, -0.075], facing(-_Z))
        nozzle.revolve([(0.003, 0), (0.007, 0.012)], 8, [plain(0.3)])
        nozzle.decal(circle(0.0055, 8), 0.04, 0.0122)


def _payload_module(surface: Surface) -> None:
    """The narrower upper box; its telescopes look along z through the sun shield or stand beside it."""
    surface.box([0, 0, 0.03], np.diag([0.034, 0.04, 0.045]), _FOIL)
    surface.box([0, 0, 0.077], np.diag([0.042, 0.047, 0.002]), _SHIELD)
    # A long spectrometer on one side and a coronagraph with its wide mouth on the other.
    surface.box([0.045, -0.014, 0.036], np.diag([0.011, 0.013, 0.055]), _BLANKET)
    surface.box([0.044, 0.02, 0.022], np.diag([0.009, 0.012, 0.036]), _DARK)
    _telescope(surface.placed([-0.05, 0.012, -0.01]), 0.017, 0.115)
    _telescope(surface.placed([-0.045, -0.025, 0.0]), 0.011, 0.085)
    surface.box([0.004, 0.049, 0.035], np.diag([0.02, 0.009, 0.026]), _BLANKET)
    surface.box([-0.008, -0.047, 0.045], np.diag([0.014, 0.007, 0.022]), _DARK)
    for x, y, radius in ((-0.018, -0.02, 0.009), (0.012, 0.018, 0.007), (0.016, -0.022, 0.005), (-0.012, 0.024, 0.006)):
        _telescope(surface.placed([x, y, 0.078]), radius, 0.014)


def _telescope(surface: Surface, radius: float, length: float) -> None:
    """Add a tube from z = 0 up to `length`, with a white rim and a dark mouth."""
    tube = Mosaic((1, 3), 0.35, (0.1, 0.8, 0.9), cover=0.5, inset=(0.1, 0.3))
    rim = 1.15 * radius
    profile = [(radius, 0.0), (radius, 0.85 * length), (rim, 0.86 * length), (rim, length)]
    surface.revolve(profile, 12, [tube, plain(0.9), plain(0.9)])
    surface.decal(circle(radius, 12), 0.04, length + 2e-4)
    surface.decal(rectangle(0.5 * radius, 0.5 * radius, (-0.2 * radius, 0.15 * radius)), 0.5, length + 4e-4)


def _high_gain_antenna(surface: Surface) -> None:
    """Add the dish on its boom, under the service module and towards the viewer's side."""
    surface.rod([0.03, -0.02, -0.074], [0.062, -0.03, -0.088], 0.0025, 0.6)
    dish = surface.placed([0.062, -0.03, -0.088], facing([0.8, -0.3, -0.35]))
    radius, depth = 0.026, 0.008
    bowl = [Mosaic((1, 1), 0.9, (0.6, 0.75), inset=(0.05, 0.3)), plain(0.95)]
    dish.revolve(
        [(0.0, -0.002), (radius, depth - 0.001), (radius, depth), (0.0, 0.0)], 16, [plain(0.3), plain(0.8), *bowl]
    )
    dish.rod([0, 0, 0], [0, 0, 0.018], 0.0025, 0.15)
