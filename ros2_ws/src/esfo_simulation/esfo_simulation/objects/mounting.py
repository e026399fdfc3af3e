"""Placement of an object on the turntable: off centre and tilted, as one that is set up by hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esfo_core.orbit import rotation
from esfo_simulation.render.surface import Model

_X, _Y, _ = np.eye(3)


@dataclass(frozen=True)
class Mounting:
    """From a body's own coordinates to those of the turntable, whose z is the spin axis.

    offset_m: (x, y, z) of the body's origin on the turntable. tilt_deg: turn about x, then about y. scale: factor from
    the body's size to that of the model.
    """

    offset_m: tuple[float, float, float]
    tilt_deg: tuple[float, float]
    scale: float = 1.0

    def place(self, body: Model) -> Model:
        """Return the body as it stands on the turntable."""
        about_x, about_y = np.radians(self.tilt_deg)
        R = rotation(_Y, float(about_y)) @ rotation(_X, float(about_x))
        return body.moved(self.scale * R, np.array(self.offset_m))
