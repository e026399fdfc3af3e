"""Draw docs/images/objects.png: the objects of the simulator as they look, and the events of a moment below."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from esfo_simulation.objects.catalogue import OBJECTS
from esfo_simulation.render.renderer import Renderer, Window
from esfo_simulation.scene import Scene, SceneOptions, simulate
from esfo_simulation.simulator import BLUR_PX

mpl.use("Agg")

# A side from which each is known at once: degrees from its first pose.
PHASE_DEG = {"hubble": 150.0, "soho": 245.0, "tdrs": 330.0, "dualshock": -25.0, "switch": -25.0, "camera": -60.0}
SIZE_PX = 400
DURATION_NS = 30_000_000
ELEVATION_DEG = 25.0


def photograph(scene: Scene) -> NDArray[np.float64]:
    """Radiance (H, W) at the middle of the scene, with the gamma of a screen."""
    s = scene.simulation
    renderer = Renderer(s.model, s.camera, Window(0, 0, s.camera.width, s.camera.height), s.light, BLUR_PX)
    frame = renderer.render(*s.motion.pose(float(s.times[[0, -1]].mean())))
    return np.exp(renderer.levels.log_radiance(frame)) ** (1 / 2.2)


def accumulate(scene: Scene) -> NDArray[np.float64]:
    """Picture (H, W, 3) of all events: on red, off blue, white where there are none."""
    counts = np.zeros((2, scene.camera.height, scene.camera.width))
    for events in scene.chunks():
        np.add.at(counts, (events["p"].astype(int), events["y"], events["x"]), 1)
    off, on = np.minimum(counts / 2, 1)
    return 1 - 0.85 * np.stack([off, np.maximum(off, on), on], axis=-1)


def show(panel: Axes, image: NDArray[np.float64], title: str = "") -> None:
    """Show a picture without ticks."""
    panel.imshow(image, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    panel.set_title(title)
    panel.set_xticks([])
    panel.set_yticks([])


def main(path: Path) -> None:
    """Draw every object of the catalogue into one picture."""
    figure = Figure(figsize=(2.8 * len(OBJECTS), 5.9), layout="constrained")
    panels = figure.subplots(2, len(OBJECTS))
    for (top, bottom), name in zip(panels.T, OBJECTS, strict=True):
        scene = simulate(
            SceneOptions(
                object=name,
                view="custom",
                elevation_deg=ELEVATION_DEG,
                phase_deg=PHASE_DEG[name],
                speed="slow",
                duration_s=DURATION_NS / 1e9,
                width=SIZE_PX,
                height=SIZE_PX,
            )
        )
        show(top, photograph(scene), name)
        show(bottom, accumulate(scene))
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/objects.png"))
