"""Scenes in the manner of the Event Camera Dataset: a hand-held DAVIS240C before `shapes`, a `poster` and `boxes`.

Mueggler et al., "The Event-Camera Dataset and Simulator", IJRR 2017.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from esfo_core.camera import Camera
from esfo_core.events import NS_PER_S
from esfo_core.options import check, option
from esfo_simulation.handheld.rooms import EVEN_LIGHT, ROOMS
from esfo_simulation.handheld.schedule import frame_times_in_view
from esfo_simulation.handheld.trajectory import MOTIONS, HandheldTrajectory, random_trajectory
from esfo_simulation.render.renderer import Window
from esfo_simulation.scene import START_NS
from esfo_simulation.sensor.options import SensorOptions
from esfo_simulation.simulator import Simulation

DAVIS240C = Camera(
    240,
    180,
    np.array([[200.0, 0, 131.0], [0, 199.5, 108.0], [0, 0, 1.0]]),
    "plumb_bob",
    np.array([-0.36, 0.14, -3e-4, -6e-4, 0.0]),
)
"""A typical DAVIS240C: a view of 70 by 52 degrees through a wide lens, whose barrel distortion is 50 px in a corner."""


@dataclass(frozen=True)
class HandheldOptions:
    """Options of a simulated hand-held camera."""

    scene: str = option("shapes", "scene in front of the camera", choices=tuple(ROOMS))
    motion: str = option("6dof", "motion of the camera", choices=tuple(MOTIONS))
    duration_s: float = option(10.0, "duration, s; the motion accelerates throughout", 0.01, 600.0)
    speed: float = option(1.0, "speed of the motion relative to that of the dataset", 0.05, 5.0)
    seed: int = option(1, "seed of the scene, the motion and all noise", 0, 2**31)
    sensor: SensorOptions = field(default_factory=SensorOptions)


@dataclass(frozen=True)
class HandheldScene:
    """A scene that is ready to be recorded: `simulation.chunks()` are its events, `trajectory` is its truth."""

    options: HandheldOptions
    simulation: Simulation
    trajectory: HandheldTrajectory


def handheld_scene(options: HandheldOptions, camera: Camera = DAVIS240C) -> HandheldScene:
    """Set a scene up. Raises OptionError for impossible options."""
    check(options)
    span = (START_NS, START_NS + round(options.duration_s * NS_PER_S))
    trajectory = random_trajectory(options.motion, span, options.seed, options.speed)
    model = ROOMS[options.scene](options.seed)
    times = frame_times_in_view(trajectory, model, camera, span)
    simulation = Simulation(
        model,
        trajectory,
        camera,
        Window(0, 0, camera.width, camera.height),
        times,
        len(times),
        options.sensor,
        light=EVEN_LIGHT,
        seed=options.seed,
    )
    return HandheldScene(options, simulation, trajectory)
