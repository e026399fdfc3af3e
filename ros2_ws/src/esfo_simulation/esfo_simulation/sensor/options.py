"""What an event sensor is like: the options of its pixels, its noise and its read-out."""

from __future__ import annotations

from dataclasses import dataclass

from esfo_core.options import option


@dataclass(frozen=True)
class SensorOptions:
    """The event sensor. Only thresholds, dead time and a little noise are on unless asked for."""

    threshold_on: float = option(0.3, "rise of log intensity that makes an ON event", 0.02, 5.0)
    threshold_off: float = option(0.3, "fall of log intensity that makes an OFF event", 0.02, 5.0)
    mismatch: float = option(0.03, "standard deviation of both thresholds over the pixels, relative", 0.0, 0.3)
    refractory_us: float = option(100.0, "dead time of a pixel after an event, us", 0.0, 1e6)
    bandwidth_hz: float = option(
        0.0, "-3 dB bandwidth at the brightest level, proportional to intensity, Hz; 0: no limit", 0.0, 1e6
    )
    leak_hz: float = option(0.05, "rate of ON events by leakage of a pixel in the dark, Hz", 0.0, 1e4)
    shot_hz: float = option(0.05, "rate of shot-noise events, both polarities, of a pixel in the dark, Hz", 0.0, 1e4)
    noise_spread: float = option(0.1, "standard deviation of the noise rates over the pixels, decades", 0.0, 1.0)
    hot_pixels: float = option(0.0, "share of pixels that are hot", 0.0, 0.1)
    hot_hz: float = option(50.0, "mean event rate of a hot pixel, Hz", 0.0, 1e5)
    hot_kind: str = option(
        "leak",
        "hot pixels fire ON at regular intervals (leak) or both polarities at random (shot)",
        choices=("leak", "shot"),
    )
    jitter_us: float = option(
        0.0, "standard deviation of the time stamps, truncated at 4 standard deviations, us", 0.0, 1e4
    )
    readout_mevs: float = option(0.0, "read-out rate, events per microsecond; 0: no limit", 0.0, 1e4)
    readout_queue: int = option(
        0, "length of the read-out queue, then events are dropped; 0: unlimited, with late time stamps", 0, 10**9
    )
    flicker_hz: float = option(0.0, "frequency of the flicker of the illumination, Hz; 0: none", 0.0, 1e4)
    flicker_depth: float = option(0.0, "amplitude of the flicker, relative to the mean intensity", 0.0, 0.95)
