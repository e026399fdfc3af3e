"""A spinning object before a static event camera, simulated with exact truth: scenes in the manner of TOPSPIN."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from esfo_core.camera import Camera
from esfo_core.errors import SimulationError
from esfo_core.events import NS_PER_S, EventArray
from esfo_core.options import check, option
from esfo_core.orbit import Matrix, Spin, Vector, object_frame, rotation
from esfo_simulation.motion import BodyMotion
from esfo_simulation.objects.catalogue import OBJECTS
from esfo_simulation.objects.mesh import read_mesh
from esfo_simulation.render.renderer import BLUR_REACH, Window
from esfo_simulation.render.surface import Model
from esfo_simulation.sensor.catalogue import sensor_model
from esfo_simulation.sensor.options import SensorOptions
from esfo_simulation.simulator import Progress, Simulation, frame_times

VIEWS = {"topdown": (65.0, 10.0), "sideon": (6.0, 4.0), "perpendicular": (12.0, 83.0), "diagonal": (42.0, 25.0)}
"""Perspectives named as in the paper (Table 1): (elevation, roll) of the axis in degrees.

Elevation 0 is an axis across the view, 90 one towards the camera; roll 0 is an axis upright in the image. The angles
are ours, the paper does not print its own; none is a round one, so that no scene is a special case by chance.
"""

SPEEDS_HZ = {"slow": 0.2, "medium": 0.5, "fast": 1.0}

START_NS = NS_PER_S
"""Sensor time of the first frame: not 0, which ROS takes for no time."""

FOCAL_PER_HEIGHT = 5 / 3
"""Default focal length over the height of the image: a field of view of 33 degrees from top to bottom."""

FILL = 0.85
"""Share of the smaller side of the image that the sphere round the moving object covers at the default distance."""

_POSES_PER_TURN = 720


@dataclass(frozen=True)
class MotionOptions:
    """Departures from a constant rate about a fixed axis."""

    rate_slope_hz_s: float = option(0.0, "change of the spin rate, Hz per second", -100.0, 100.0)
    nutation_deg: float = option(
        0.0, "angle between the symmetry axis of the body and the fixed axis, degrees", 0.0, 80.0
    )
    inertia_ratio: float = option(
        0.7, "nutating body: ratio of the axial to the transverse moment of inertia", 0.05, 2.0
    )
    velocity_x_m_s: float = option(0.0, "velocity of the object to the right, m/s", -1e3, 1e3)
    velocity_y_m_s: float = option(0.0, "velocity of the object downwards, m/s", -1e3, 1e3)
    velocity_z_m_s: float = option(0.0, "velocity of the object away from the camera, m/s", -1e3, 1e3)


@dataclass(frozen=True)
class SceneOptions:
    """Options of a simulated scene."""

    object: str = option("hubble", "object that spins", choices=tuple(OBJECTS))
    mesh: str = option("", "mesh file (.ply, .obj, .glb, .stl) instead of `object`")
    mesh_up: str = option("z", "axis of the mesh that becomes the spin axis", choices=("x", "y", "z"))
    mesh_patchwork: str = option(
        "none", "random albedo for each facet or face of a mesh without colours", choices=("none", "facets", "faces")
    )
    mesh_size_m: float = option(0.0, "largest extent after scaling of the mesh, m; 0: not scaled", 0.0, 1e4)
    view: str = option("diagonal", "viewpoint, named as in the paper", choices=(*VIEWS, "custom"))
    elevation_deg: float = option(
        0.0,
        "view custom: elevation of the axis; 0: parallel to the image, 90: towards the camera, degrees",
        -90.0,
        90.0,
    )
    roll_deg: float = option(0.0, "view custom: rotation of the axis in the image; 0: upright, degrees", -180.0, 180.0)
    speed: str = option("medium", "spin rate by name: 0.2, 0.5, 1 or 0 Hz", choices=(*SPEEDS_HZ, "still"))
    rate_hz: float = option(0.0, "spin rate in Hz; 0: by `speed`", 0.0, 1000.0)
    revolutions: float = option(2.5, "number of revolutions", 0.01, 1000.0)
    duration_s: float = option(0.0, "duration in s; 0: by `revolutions`", 0.0, 1e5)
    width: int = option(480, "sensor width in px", 16, 4096)
    height: int = option(360, "sensor height in px", 16, 4096)
    focal_px: float = option(0.0, "focal length in px; 0: 5/3 of the height", 0.0, 1e5)
    camera: str = option("", "calibration (YAML) with lens distortion, instead of width, height and focal_px")
    distance_m: float = option(0.0, "distance to the object in m; 0: the object fills most of the image", 0.0, 1e5)
    offset_x: float = option(
        0.0075, "offset of the object to the right of the optical axis, divided by the distance", -10.0, 10.0
    )
    offset_y: float = option(
        -0.005, "offset of the object below the optical axis, divided by the distance", -10.0, 10.0
    )
    phase_deg: float = option(0.0, "rotation angle of the object in the first frame, degrees", -360.0, 360.0)
    seed: int = option(1, "seed of the surface pattern and of all noise", 0, 2**31)
    max_events: int = option(500_000_000, "largest number of events; a larger scene is an error", 1, 10**12)
    motion: MotionOptions = field(default_factory=MotionOptions)
    sensor: SensorOptions = field(default_factory=SensorOptions)

    @staticmethod
    def of_sensor(name: str, focal_mm: float = 0.0) -> SceneOptions:
        """Return the defaults with the pixels of a named sensor, behind a lens of focal_mm mm; 0: 5/3 of the height.

        Raises SimulationError for an unknown name.
        """
        sensor = sensor_model(name)
        return SceneOptions(
            width=sensor.width, height=sensor.height, focal_px=sensor.focal_px(focal_mm), sensor=sensor.options
        )

    @property
    def spin_rate_hz(self) -> float:
        """The spin rate at the beginning, 0 for a body that only stands or moves on."""
        return self.rate_hz or SPEEDS_HZ.get(self.speed, 0.0)


@dataclass(frozen=True)
class Scene:
    """A scene that is set up: what was asked for, the motion, and the simulation of it."""

    options: SceneOptions
    motion: BodyMotion
    simulation: Simulation

    @property
    def spin(self) -> Spin:
        """Axis, rate and centre at the time of the first frame, t0; metres."""
        return self.motion.spin

    @property
    def camera(self) -> Camera:
        """The camera that watches."""
        return self.simulation.camera

    def chunks(self, progress: Progress | None = None) -> Generator[EventArray, None, int]:
        """As `Simulation.chunks`."""
        return self.simulation.chunks(progress)

    def model_at(self, t: int) -> Model:
        """Return the object at `t` ns, in coordinates parallel to the camera's, with the origin at the centre."""
        R, _ = self.motion.pose(float(t))
        return self.simulation.model.moved(R, np.zeros(3))


def view_axis(elevation_deg: float, roll_deg: float) -> Vector:
    """Spin axis (3,) in the camera's optical frame of a perspective; angles as in `VIEWS`."""
    elevation, roll = np.radians([elevation_deg, roll_deg])
    upright = np.array([0.0, -np.cos(elevation), -np.sin(elevation)])
    return np.asarray(rotation(np.array([0.0, 0, 1]), roll) @ upright)


def simulate(options: SceneOptions) -> Scene:
    """Set a scene up.

    Raises OptionError for impossible options, CameraError and SimulationError for files that cannot be used, and
    SimulationError for an object outside the view.
    """
    check(options)
    camera = _camera(options)
    angles = (options.elevation_deg, options.roll_deg) if options.view == "custom" else VIEWS[options.view]
    axis = view_axis(*angles)
    model = _model(options).moved(rotation(axis, np.radians(options.phase_deg)) @ object_frame(axis), np.zeros(3))
    distance = options.distance_m or _distance(model, camera)
    center = distance * np.array([options.offset_x, options.offset_y, 1.0])
    motion = _motion(options, Spin(axis, options.spin_rate_hz, center, START_NS))
    times, turn, bounds = _schedule(options, motion, model, camera)
    simulation = Simulation(
        model,
        motion,
        camera,
        _window(bounds, camera),
        times,
        turn,
        options.sensor,
        seed=options.seed,
        max_events=options.max_events,
    )
    return Scene(options, motion, simulation)


def _camera(options: SceneOptions) -> Camera:
    if options.camera:
        return Camera.read_yaml(Path(options.camera))
    return Camera.pinhole(options.width, options.height, options.focal_px or FOCAL_PER_HEIGHT * options.height)


def _model(options: SceneOptions) -> Model:
    if options.mesh:
        return read_mesh(
            Path(options.mesh),
            options.mesh_size_m or None,
            options.seed,
            patchwork=options.mesh_patchwork,  # type: ignore[arg-type]
            up=options.mesh_up,  # type: ignore[arg-type]
        )
    return OBJECTS[options.object](options.seed)


def _distance(model: Model, camera: Camera) -> float:
    """Distance at which the sphere round the moving model covers `FILL` of the smaller side of the image."""
    reach = float(np.linalg.norm(model.vertices, axis=1).max())
    half = FILL * min(camera.width / camera.K[0, 0], camera.height / camera.K[1, 1]) / 2
    return float(reach * np.hypot(1, 1 / half))


def _motion(options: SceneOptions, spin: Spin) -> BodyMotion:
    m = options.motion
    velocity = np.array([m.velocity_x_m_s, m.velocity_y_m_s, m.velocity_z_m_s])
    return BodyMotion(spin, m.rate_slope_hz_s, np.radians(m.nutation_deg), m.inertia_ratio, velocity)


def _schedule(options: SceneOptions, motion: BodyMotion, model: Model, camera: Camera) -> tuple[Matrix, int, Matrix]:
    """Return the times of the frames, after how many they repeat, and the bounds of the image."""
    rate = motion.spin.rate_hz
    if not rate and not options.duration_s:
        raise SimulationError("an object that does not spin needs duration_s")
    if options.duration_s:
        turns = float(motion.turns(np.array(START_NS + options.duration_s * NS_PER_S)))
    else:
        turns = options.revolutions
    if not motion.repeats:
        end = START_NS + (options.duration_s or turns / rate) * NS_PER_S
        samples = 2 + int(_POSES_PER_TURN * max(turns, 1.0))
        times, bounds = frame_times(motion, model.vertices, camera, (START_NS, end), samples)
        return times, len(times), bounds
    # The poses of a turn do not depend on how the rate changes: they are those of a constant one.
    steady = BodyMotion(motion.spin)
    span = (START_NS, START_NS + NS_PER_S / rate)
    times, bounds = frame_times(steady, model.vertices, camera, span, _POSES_PER_TURN + 1)
    turn = len(times) - 1
    whole, part = np.divmod(np.arange(int(np.ceil(turns)) * turn + 1), turn)
    done = whole + steady.turns(times)[part]
    return motion.time_of(done[done <= turns + 1e-9]), turn, bounds


def _window(bounds: Matrix, camera: Camera) -> Window:
    low = np.floor(bounds[0]).astype(int) - BLUR_REACH - 1
    high = np.ceil(bounds[1]).astype(int) + BLUR_REACH + 1
    if (low < 0).any() or (high >= [camera.width, camera.height]).any():
        raise SimulationError(
            f"the object leaves the view: it covers columns {low[0]}..{high[0]} and rows {low[1]}..{high[1]} of "
            f"{camera.width}x{camera.height} px; use a larger distance_m or a shorter focal_px"
        )
    return Window(int(low[0]), int(low[1]), int(high[0] - low[0] + 1), int(high[1] - low[1] + 1))
