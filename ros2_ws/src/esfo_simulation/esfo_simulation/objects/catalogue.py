"""The objects of the paper's Table 1 by name."""

from __future__ import annotations

from collections.abc import Callable

from esfo_simulation.objects.davis346 import camera
from esfo_simulation.objects.dualshock import dualshock
from esfo_simulation.objects.hubble import hubble
from esfo_simulation.objects.soho import soho
from esfo_simulation.objects.switch import switch
from esfo_simulation.objects.tdrs import tdrs
from esfo_simulation.render.surface import Model

OBJECTS: dict[str, Callable[[int], Model]] = {
    "hubble": hubble,
    "soho": soho,
    "tdrs": tdrs,
    "dualshock": dualshock,
    "switch": switch,
    "camera": camera,
}
"""From the seed of the surface pattern to the object on its turntable: z is the nominal spin axis, metres."""
