"""A game controller in the manner of the DualShock 4, 1.4 times its size: about 0.23 m wide, standing upright."""

from __future__ import annotations

import numpy as np

from esfo_simulation.objects.mounting import Mounting
from esfo_simulation.render.surface import (
    Model,
    Mosaic,
    Points,
    Surface,
    circle,
    facing,
    plain,
    rectangle,
    rounded,
)

_X, _Y, _Z = np.eye(3)
_MOUNTING = Mounting(offset_m=(0.003, -0.004, 0.005), tilt_deg=(-7.0, 2.0), scale=1.4)
_SHELL, _DARK, _TRIM, _PRINT = 0.13, 0.05, 0.3, 0.9

_GRIP = Mosaic((1, 2), _SHELL, (0.05, 0.24, 0.34), cover=0.5, inset=(0.1, 0.32))
_TOUCH_PAD = Mosaic((5, 3), 0.26, (0.12, 0.16, 0.4, 0.5), cover=0.75, inset=(0.1, 0.32))
_STICKER = Mosaic((6, 4), 0.85, (0.06, 0.1, 0.2), cover=0.8, inset=(0.08, 0.3))
_KNURL = Mosaic((1, 1), 0.22, (0.06, 0.09), cover=0.9, inset=(0.1, 0.25))


def dualshock(seed: int) -> Model:
    """Return the controller with the buttons looking along -y and the light bar up (z).

    It stands 5 mm beside the spin axis, 5 mm high, and leans back by 7 degrees. Its outline nearly repeats after half a
    turn; buttons on one face, label and screws on the other do not. `seed` draws the pattern of grips, touch pad and
    label. Metres.
    """
    surface = Surface(np.random.default_rng(seed))
    # The body's own coordinates: x to the right of the player, y away from the player, z out of the face.
    body = surface.placed([0, 0, -0.004], facing(-_Y))
    _shell(body)
    _touch_pad(body.placed([0, 0.021, 0.0135]))
    for side in (-1.0, 1.0):
        _grip(body, side)
        _stick(body.placed([side * 0.0265, -0.011, 0.0115]))
        _triggers(body, side)
    _direction_pad(body.placed([-0.053, 0.013, 0.0135]))
    _action_buttons(body.placed([0.053, 0.013, 0.0135]))
    _small_parts(body)
    _back(body.placed([0, 0.01, -0.0145], facing(-_Z, _Y)))
    return _MOUNTING.place(surface.build())


def _shell(body: Surface) -> None:
    outline = [(0.118, 0.044, -0.0135), (0.124, 0.05, -0.008), (0.124, 0.05, 0.008), (0.118, 0.045, 0.0135)]
    rings = [np.insert(rounded(w, h, [0.008] * 4, 4, (0, 0.0125)), 2, z, axis=1) for w, h, z in outline]
    body.loft(np.array(rings), [plain(_SHELL)])
    body.placed([0, -0.008, 0]).extrude(rounded(0.078, 0.034, [0.012] * 4, 4), -0.0115, 0.0115, [plain(_SHELL)])
    for side in (-1.0, 1.0):
        pad = body.placed([side * 0.053, 0.0125, 0])
        pad.revolve([(0.019, -0.0145), (0.0255, -0.008), (0.0255, 0.008), (0.02, 0.0135)], 20, [plain(_SHELL)])
        pad.decal(circle(0.0185, 20), 0.18, 0.0137)
    body.box([0, 0.038, 0.003], np.diag([0.021, 0.0015, 0.0045]), plain(0.95))


def _grip(body: Surface, side: float) -> None:
    """Add the handle, bent outwards and to the back, round at its end."""
    start, end = np.array([side * 0.054, 0.008, -0.001]), np.array([side * 0.070, -0.066, -0.017])
    grip = body.placed(start, facing(end - start, _Z))
    reach = float(np.linalg.norm(end - start))
    profile = ((0.0225, 0.0), (0.0228, 0.25), (0.0205, 0.5), (0.0175, 0.72), (0.0145, 0.88), (0.0095, 0.97), (0.0, 1.0))
    rings = [np.insert(circle(r, 14) * [1.0, 0.86], 2, share * reach, axis=1) for r, share in profile]
    grip.loft(np.array(rings), [plain(_SHELL), _GRIP, _GRIP, _GRIP, plain(_SHELL), plain(_SHELL)])


def _touch_pad(surface: Surface) -> None:
    surface.extrude(rounded(0.054, 0.028, [0.004] * 4, 4), -0.002, 0.0012, [plain(_TRIM)])
    surface.panel(0.05, 0.024, _TOUCH_PAD, (0, 0), 0.0014)


def _stick(surface: Surface) -> None:
    """Add the well, the shaft and the cap with its knurled rim and hollow top."""
    surface.revolve([(0.0155, -0.004), (0.0155, 0.0022)], 18, [plain(_TRIM)])
    surface.decal(circle(0.0135, 18), _DARK, 0.0024)
    surface.revolve([(0.006, 0.002), (0.0045, 0.008)], 10, [plain(0.09)])
    cap = [(0.006, 0.007), (0.0105, 0.0085), (0.0105, 0.0115), (0.0085, 0.0128), (0.0, 0.0112)]
    surface.revolve(cap, 18, [plain(0.09), _KNURL, plain(0.34), plain(0.1)])


def _triggers(body: Surface, side: float) -> None:
    upper = body.placed([side * 0.053, 0.037, 0.005])
    upper.extrude(rounded(0.03, 0.012, [0.004] * 4, 3), -0.004, 0.004, [plain(0.2)])
    lower = body.placed([side * 0.053, 0.038, -0.007])
    lower.box([0, 0, 0], np.diag([0.0125, 0.010, 0.0055]), plain(0.08))
    front = lower.placed([0, 0.0102, 0], facing(_Y, _Z))
    front.panel(0.02, 0.008, Mosaic((2, 1), 0.08, (0.5, 0.8), 1.0), z=0.0)


def _direction_pad(surface: Surface) -> None:
    """Add four arms that point to the middle, each with a bright mark."""
    arm = np.array([[0.0, 0.003], [0.0045, 0.0075], [0.0045, 0.0145], [-0.0045, 0.0145], [-0.0045, 0.0075]])
    mark = np.array([[0.0, 0.0128], [-0.0018, 0.0098], [0.0018, 0.0098]])
    for quarter in range(4):
        turn = np.array([[0.0, -1.0], [1.0, 0.0]])
        R = np.linalg.matrix_power(turn, quarter)
        surface.extrude(arm @ R.T, 0.0, 0.0032, [plain(0.38)])
        surface.decal(mark @ R.T, _PRINT, 0.0034)


def _action_buttons(surface: Surface) -> None:
    """Add the four round buttons: triangle up, circle right, cross down, square left."""
    triangle = circle(0.0036, 3) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    bar = rectangle(0.0075, 0.0014) @ np.array([[1.0, 1.0], [-1.0, 1.0]]) / np.sqrt(2)
    marks: dict[tuple[float, float], list[tuple[Points, float]]] = {
        (0.0, 1.0): [(triangle, _PRINT), (0.5 * triangle, _DARK)],
        (1.0, 0.0): [(circle(0.0034, 12), _PRINT), (circle(0.0021, 12), _DARK)],
        (0.0, -1.0): [(bar, _PRINT), (bar[:, ::-1] * [-1, 1], _PRINT)],
        (-1.0, 0.0): [(rectangle(0.006, 0.006), _PRINT), (rectangle(0.0034, 0.0034), _DARK)],
    }
    for place, layers in marks.items():
        button = surface.placed([0.0115 * place[0], 0.0115 * place[1], 0.0])
        button.revolve([(0.0055, 0.0), (0.0055, 0.003), (0.0048, 0.0038)], 14, [plain(_DARK)])
        for k, (outline, albedo) in enumerate(layers):
            button.decal(outline, albedo, 0.004 + 1e-4 * k)


def _small_parts(body: Surface) -> None:
    """Add share and options keys, the home button, the speaker's holes and the sockets at the lower edge."""
    for x, y in ((-0.0315, 0.0285), (0.0315, 0.0285)):
        body.placed([x, y, 0.0125]).extrude(rounded(0.0034, 0.008, [0.0016] * 4, 3), 0.0, 0.0022, [plain(0.6)])
    home = body.placed([0, -0.011, 0.0115])
    home.revolve([(0.005, 0.0), (0.005, 0.0015)], 12, [plain(0.2)])
    home.decal(rectangle(0.0014, 0.006), _PRINT, 0.0017)
    home.decal(rectangle(0.005, 0.0014, (0.0004, -0.0012)), _PRINT, 0.0018)
    for row, count in ((0, 5), (1, 4), (2, 5)):
        for k in range(count):
            body.decal(circle(0.0007, 6, (0.0028 * (k - (count - 1) / 2), 0.0038 - 0.0024 * row)), 0.75, 0.0138)
    sockets = body.placed([0, -0.0252, 0], facing(-_Y, _Z))
    sockets.decal(circle(0.003, 10, (0.006, 0)), 0.6)
    sockets.decal(circle(0.0018, 10, (0.006, 0)), 0.03, 4e-4)
    sockets.decal(rectangle(0.009, 0.004, (-0.008, 0)), 0.5)


def _back(surface: Surface) -> None:
    """Add the label with its print, and the screws."""
    surface.panel(0.05, 0.022, _STICKER, (0.004, 0.0), 0.0)
    for x, y in ((-0.046, 0.014), (0.048, 0.012), (-0.04, -0.016), (0.042, -0.018)):
        surface.decal(circle(0.003, 8, (x, y)), 0.7)
        surface.decal(rectangle(0.004, 0.001, (x, y)), 0.05, 4e-4)
