"""The estimate of an orbit, which the back-end publishes and `esfo run` writes."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from esfo_core.camera import Camera
from esfo_core.orbit import OrbitError, Spin

Status = Literal["ok", "degenerate", "failed"]

Level = Literal["orbit", "image_axis", "rate", "none"]
"""How much is known: the whole orbit; the rate and the image of the axis; the rate alone; nothing."""


WITH_MOTION: tuple[Level, ...] = ("orbit", "image_axis")
"""Levels at which there is a motion."""


@dataclass(frozen=True)
class RateEstimate:
    """A spin rate and its standard deviation, Hz."""

    rate_hz: float
    std_hz: float


@dataclass(frozen=True)
class Alternative:
    """An alternative solution that was considered.

    kind: `harmonic` (another period of the event stream), `mirror` or `axis` (another optimum of the same rate).
    rate_hz: its rate. axis: (3,) its axis; zeros where only a rate was considered.
    score_ratio: its fit compared with the published solution, 1 = equally good, larger = worse:
    correlation(published) / correlation(alternative) for a harmonic, robust cost ratio otherwise.
    """

    kind: str
    rate_hz: float
    axis: NDArray[np.float64]
    score_ratio: float


@dataclass(frozen=True)
class OrbitEstimate:
    """Spin and structure, with their uncertainty and a verdict.

    status: `ok` (the whole orbit can be trusted), `degenerate` (something named in flags is not observable) or `failed`
    (no rate; reason says why). level: how much is known.
    spin: the motion; None at the levels `rate` and `none`. rate_hz: the spin rate; NaN at the level `none`.
    stream_rate, track_rate: the same rate from the event stream alone and from re-observed tracks alone, None where
    they do not show it. Lengths are in units of `scale`: `unit` sets the orbit radius to 1.
    rate_std_hz: standard deviation of the rate; with the flag rate_not_constant the rate is that at spin.t0.
    rate_slope_hz_s, rate_slope_std_hz_s: change of the rate with its standard deviation, Hz per second.
    focal_px, focal_std_px: estimated focal length with its standard deviation; NaN for a calibrated camera.
    axis_cov: (2, 2) rad^2 in `tangent_basis(axis)`.
    points: (P, 3) in the object's coordinates at spin.t0 (camera-aligned, origin at spin.center).
    point_rms_px, point_observations: (P,) reprojection error and number of observations of each point.
    tracks, observations: how many of each support the points. revolutions: turns seen.
    t_first, t_last: ns, span of the data.
    """

    status: Status
    flags: tuple[str, ...]
    reason: str
    spin: Spin | None
    rate_hz: float
    rate_std_hz: float
    axis_cov: NDArray[np.float64]
    points: NDArray[np.float64]
    point_rms_px: NDArray[np.float64]
    point_observations: NDArray[np.int64]
    tracks: int
    observations: int
    revolutions: float
    rms_px: float
    initialisation: str
    rate_slope_hz_s: float = math.nan
    rate_slope_std_hz_s: float = math.nan
    focal_px: float = math.nan
    focal_std_px: float = math.nan
    level: Level = "none"
    stream_rate: RateEstimate | None = None
    track_rate: RateEstimate | None = None
    scale: str = "unit"
    t_first: int = 0
    t_last: int = 0
    alternatives: tuple[Alternative, ...] = ()
    timing_s: dict[str, float] = field(default_factory=dict)

    @property
    def axis_std_deg(self) -> float:
        """Standard deviation of the axis direction in degrees: root of the larger eigenvalue of axis_cov.

        NaN where axis_cov is not finite, because the eigenvalues of such a matrix are arbitrary.
        """
        if not np.isfinite(self.axis_cov).all():
            return math.nan
        return float(np.degrees(np.sqrt(max(np.linalg.eigvalsh(self.axis_cov)[-1], 0.0))))

    def camera(self, assumed: Camera) -> Camera:
        """Return the camera that the estimate is for: `assumed`, or that with the focal length that was estimated."""
        return assumed.with_focal(self.focal_px, self.focal_std_px / self.focal_px) if self.focal_px > 0 else assumed

    @staticmethod
    def failure(reason: str, **known: object) -> OrbitEstimate:
        """Return a failed estimate with its reason; `known` may set other fields, such as tracks or flags."""
        values: dict[str, object] = {
            "status": "failed",
            "flags": (),
            "reason": reason,
            "spin": None,
            "rate_hz": float("nan"),
            "rate_std_hz": float("nan"),
            "axis_cov": np.full((2, 2), np.nan),
            "points": np.empty((0, 3)),
            "point_rms_px": np.empty(0),
            "point_observations": np.empty(0, np.int64),
            "tracks": 0,
            "observations": 0,
            "revolutions": 0.0,
            "rms_px": float("nan"),
            "initialisation": "none",
        }
        return OrbitEstimate(**{**values, **known})  # type: ignore[arg-type]

    def to_json(self, versions: dict[str, str]) -> dict[str, object]:
        """Return the content of `orbit.json`, always with the same keys; null stands for values that do not exist.

        Lengths (`center`, `radius`, `orbit`) are in units of `scale`, angles in degrees, times in ns or s as named.
        """
        out: dict[str, object] = {
            "status": self.status,
            "level": self.level,
            "flags": list(self.flags),
            "reason": self.reason,
            "spin_rate_hz": self.rate_hz,
            "spin_rate_std_hz": self.rate_std_hz,
            "rates": {"stream": _rate_fields(self.stream_rate), "tracks": _rate_fields(self.track_rate)},
            **_spin_fields(self.spin),
            "spin_rate_slope_hz_s": self.rate_slope_hz_s,
            "spin_rate_slope_std_hz_s": self.rate_slope_std_hz_s,
            "axis_std_deg": self.axis_std_deg,
            "focal_px": self.focal_px,
            "focal_std_px": self.focal_std_px,
            "scale": self.scale,
            "points": len(self.points),
            "tracks": self.tracks,
            "observations": self.observations,
            "revolutions": self.revolutions,
            "rms_reprojection_px": self.rms_px,
            "initialisation": self.initialisation,
            "alternatives": [
                {"kind": a.kind, "rate_hz": a.rate_hz, "axis": a.axis, "score_ratio": a.score_ratio}
                for a in self.alternatives
            ],
            "timing_s": self.timing_s,
            "versions": versions,
        }
        return {key: _plain(value) for key, value in out.items()}

    def write_json(self, path: Path, versions: dict[str, str]) -> None:
        """Write `orbit.json`."""
        path.write_text(json.dumps(self.to_json(versions), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _rate_fields(rate: RateEstimate | None) -> dict[str, float] | None:
    return None if rate is None else {"hz": rate.rate_hz, "std_hz": rate.std_hz}


def _spin_fields(spin: Spin | None) -> dict[str, object]:
    if spin is None:
        return dict.fromkeys(("axis", "center", "t0_ns", "radius", "orbit"))
    motion = {"axis": spin.axis, "center": spin.center, "t0_ns": spin.t0}
    try:
        orbit = spin.paper_orbit()
    except OrbitError:  # the axis passes through the camera: the motion is known, its circle is a point
        return {**motion, "radius": 0.0, "orbit": None}
    return {**motion, "radius": orbit.radius, "orbit": orbit.parameters()}


def _plain(value: object) -> object:
    """Return a value that JSON can hold: arrays as lists, numbers that are not finite as None."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
