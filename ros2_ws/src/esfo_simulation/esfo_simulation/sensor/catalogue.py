"""Sensors by name: what data sheets and papers say of them, as options of the simulated one.

Resolution, pixel pitch, read-out and least contrast are those of the papers named below and of Table 1 of Gallego et
al., "Event-based Vision: A Survey", PAMI 2022. Thresholds are set by biases, which users change: here they are typical
ones, not the least that the sensor can do. Dead time, spread of noise and jitter are typical, printed nowhere; noise is
that of a room in the light of an office.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from esfo_core.errors import SimulationError
from esfo_simulation.sensor.options import SensorOptions


@dataclass(frozen=True)
class SensorModel:
    """A sensor that can be bought: width and height in px, pixel pitch in um, its options and where they come from."""

    width: int
    height: int
    pitch_um: float
    options: SensorOptions
    source: str

    def focal_px(self, focal_mm: float) -> float:
        """Return the focal length in px of a lens of focal_mm, mm."""
        return 1000.0 * focal_mm / self.pitch_um


_DAVIS = SensorOptions(
    # 3.5 % contrast of mismatch (Brandli); leak of about 0.1 Hz, all ON (Nozaki and Delbruck, TED 2017).
    threshold_on=0.25,
    threshold_off=0.25,
    mismatch=0.14,
    bandwidth_hz=1000.0,
    leak_hz=0.1,
    shot_hz=0.02,
    hot_pixels=1e-4,
    hot_hz=100.0,
    jitter_us=10.0,
    readout_mevs=12.0,
)
_PROPHESEE = SensorOptions(
    # Bandwidth is not limited here: in such light it lies far above what moves, and the simulation of it is slow.
    mismatch=0.1,
    refractory_us=200.0,
    leak_hz=0.0,
    shot_hz=0.1,
    noise_spread=0.3,
    hot_pixels=1e-4,
    hot_hz=100.0,
    hot_kind="shot",
    jitter_us=20.0,
)

SENSORS: dict[str, SensorModel] = {
    "davis240c": SensorModel(
        240,
        180,
        18.5,
        _DAVIS,
        "Brandli et al., A 240x180 130 dB 3 us latency global shutter spatiotemporal vision sensor, JSSC 2014",
    ),
    "davis346": SensorModel(
        346,
        260,
        18.5,
        # Least contrast 14.3 % ON, 22.5 % OFF (Taverni): OFF stays the less sensitive one.
        replace(_DAVIS, threshold_on=0.2, threshold_off=0.3),
        "Taverni et al., Front and back illuminated dynamic and active pixel vision sensors comparison, TCAS-II 2018",
    ),
    "gen3": SensorModel(
        640,
        480,
        15.0,
        replace(_PROPHESEE, readout_mevs=66.0),
        "Gallego et al., Event-based vision: a survey, PAMI 2022, Table 1 (Gen3 CD)",
    ),
    "gen4": SensorModel(
        1280,
        720,
        4.86,
        replace(_PROPHESEE, readout_mevs=1066.0),
        "Finateu et al., A 1280x720 back-illuminated stacked temporal contrast event-based vision sensor, ISSCC 2020",
    ),
}
"""davis240c, davis346, gen3 (Prophesee Gen3) and gen4 (Prophesee Gen4, IMX636, EVK4)."""


def sensor_model(name: str) -> SensorModel:
    """Return the sensor of that name. Raises SimulationError for an unknown one."""
    if name not in SENSORS:
        raise SimulationError(f"unknown sensor {name!r}; choose from {', '.join(SENSORS)}")
    return SENSORS[name]
