"""Whether a result can be trusted, by stated statistics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esfo_backend.covariance import MotionCovariance
from esfo_backend.drift import RateDrift
from esfo_backend.options import VerdictOptions
from esfo_core.estimate import Alternative, Status
from esfo_core.orbit import Vector, angle_between

_RATE_STD_LIMIT = 0.02


@dataclass(frozen=True)
class Evidence:
    """What the verdict looks at.

    recurring: points seen again after half a turn or more, None where tracks were not re-identified. inliers: share of
    tracks that follow the motion. duration_s: length of the data.
    """

    rate_hz: float
    axis: Vector
    towards: Vector
    covariance: MotionCovariance
    points: int
    recurring: int | None
    inliers: float
    alternatives: tuple[Alternative, ...]
    harmonic_z: float
    drift: RateDrift
    duration_s: float


@dataclass(frozen=True)
class Verdict:
    """Status, flags and one line of reason."""

    status: Status
    flags: tuple[str, ...]
    reason: str


def judge(evidence: Evidence, options: VerdictOptions) -> Verdict:
    """Return `failed` when nothing spins, `degenerate` when rate or axis are not what they seem, `ok` otherwise."""
    failure = _failure(evidence, options)
    if failure:
        return Verdict("failed", (), failure)
    flags = ["scale_unobservable"]
    if evidence.harmonic_z < 10:
        flags.append("harmonic_ambiguous")
    if any(a.kind != "harmonic" and a.score_ratio < options.mirror_ratio for a in evidence.alternatives):
        flags.append("mirror_ambiguous")
    change = evidence.drift.slope * evidence.duration_s
    if evidence.drift.significance > options.drift_z and abs(change) > options.max_drift * evidence.rate_hz:
        flags.append("rate_not_constant")
        g, s = evidence.drift.slope, evidence.drift.std
        return Verdict(
            "degenerate", tuple(flags), f"the rate is not constant: it changes by {g:+.5f} +- {s:.5f} Hz per second"
        )
    std = float(np.degrees(np.sqrt(np.linalg.eigvalsh(evidence.covariance.axis_cov)[-1])))
    off_view = min(angle_between(evidence.axis, evidence.towards), angle_between(-evidence.axis, evidence.towards))
    if std > options.max_axis_std_deg or off_view < 3 * std:
        flags.append("axis_unobservable")
        return Verdict(
            "degenerate",
            tuple(flags),
            f"the axis is not observable: {off_view:.1f} degrees off the view with a std of {std:.1f} degrees",
        )
    return Verdict("ok", tuple(flags), "")


def _failure(evidence: Evidence, options: VerdictOptions) -> str:
    if evidence.points < options.min_points:
        return f"only {evidence.points} points follow one rotation; {options.min_points} are needed"
    if evidence.recurring is not None and evidence.recurring < options.min_recurring:
        return f"only {evidence.recurring} points came round again; {options.min_recurring} are needed"
    if evidence.inliers < options.min_inliers:
        return f"only {evidence.inliers:.0%} of the tracks follow one rotation; {options.min_inliers:.0%} are needed"
    cov = evidence.covariance
    if not (np.isfinite(cov.rate_std_hz) and np.isfinite(cov.axis_cov).all()):
        return "the motion is not determined by the tracks (the factor graph is indeterminate)"
    if evidence.rate_hz <= 0 or cov.rate_std_hz > _RATE_STD_LIMIT * evidence.rate_hz:
        return f"the rate is not determined: {evidence.rate_hz:.4f} +- {cov.rate_std_hz:.4f} Hz"
    return ""
