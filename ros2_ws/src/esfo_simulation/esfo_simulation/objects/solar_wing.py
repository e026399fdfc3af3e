"""A solar wing: hinged panels in a row, cells on one face."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esfo_simulation.render.surface import Mosaic, Surface, facing, plain

_X = np.array([1.0, 0, 0])


@dataclass(frozen=True)
class SolarWing:
    """Panels along y whose cells look towards x.

    panels: number. length: of a panel along y, height: along z, gap: between two, start: y of the first; metres. cells:
    pattern of the face, back: of the other one.
    """

    panels: int
    length: float
    height: float
    gap: float
    start: float
    cells: Mosaic
    back: Mosaic

    def add(self, surface: Surface, side: float) -> None:
        """Add the wing to the surface, towards +y for side = 1 and -y for side = -1."""
        half = np.diag([0.001, self.length / 2, self.height / 2])
        for k in range(self.panels):
            y = self.start + self.length / 2 + k * (self.length + self.gap)
            center = np.array([0, side * y, 0])
            surface.box(center, half, plain(0.5))
            for normal, mosaic in ((_X, self.cells), (-_X, self.back)):
                face = surface.placed(center + 0.0012 * normal, facing(normal))
                face.panel(self.length, self.height, mosaic, z=0.0)
            for z in (-self.height / 3, self.height / 3):
                hinge = np.array([0, side * (y - self.length / 2), z])
                surface.rod(hinge, hinge - [0, side * self.gap, 0], 0.0014, 0.8)
