"""Status and flags of an estimate, from estimation statistics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esfo_backend.adjustment.covariance import MotionCovariance
from esfo_backend.options import VerdictOptions
from esfo_backend.verdict.rate_slope import RateSlope
from esfo_backend.verdict.rigidity import Rigidity
from esfo_core.estimate import Alternative, Status
from esfo_core.orbit import Vector, angle_between

_RATE_STD_LIMIT = 0.02
_HARMONIC_Z = 10.0
_MOST = 0.5


@dataclass(frozen=True)
class Evidence:
    """Statistics that the verdict is based on.

    towards: from the camera to the middle of the object. reobserved: landmarks observed again a revolution later, None
    where tracks were not re-identified; reobservable: those that could have been. inliers: share of tracks that follow
    the motion. revolutions: number observed. duration_s: length of the data.
    """

    rate_hz: float
    axis: Vector
    towards: Vector
    covariance: MotionCovariance
    points: int
    reobserved: int | None
    reobservable: int
    inliers: float
    alternatives: tuple[Alternative, ...]
    harmonic_z: float
    rate_slope: RateSlope
    rigidity: Rigidity
    revolutions: float
    duration_s: float


@dataclass(frozen=True)
class Verdict:
    """Status, flags and one line of reason."""

    status: Status
    flags: tuple[str, ...]
    reason: str


def judge(evidence: Evidence, options: VerdictOptions) -> Verdict:
    """Return `failed` without an estimate of a rotation, `degenerate` when rate or axis may be wrong, `ok` otherwise.

    The most serious doubt gives the reason; the reason of a failure includes it.
    """
    doubts = _doubts(evidence, options)
    if unconfirmed(evidence.reobserved, options):  # the other doubts assume the right rate
        doubts = [doubt for doubt in doubts if doubt[0] in ("too_few_turns", "axis_unobservable")]
    flags = [flag for flag, _ in doubts]
    reason = doubts[0][1] if doubts else ""
    failure, cause = _failure(evidence, options)
    if not failure and "not_a_rotation" in flags and moves_on(evidence.reobserved, evidence.reobservable):
        failure = (
            f"only {evidence.reobserved} of {evidence.reobservable} landmarks were observed again one revolution later"
        )
    if failure:
        named = (*flags, cause) if cause and cause not in flags else tuple(flags)
        return Verdict("failed", named, f"{failure}; {reason}" if reason else failure)
    flags.append("scale_unobservable")
    if evidence.harmonic_z < _HARMONIC_Z:
        flags.append("harmonic_ambiguous")
    if any(a.kind != "harmonic" and a.score_ratio < options.mirror_ratio for a in evidence.alternatives):
        flags.append("mirror_ambiguous")
    return Verdict("degenerate" if doubts else "ok", tuple(flags), reason)


def unconfirmed(reobserved: int | None, options: VerdictOptions) -> bool:
    """Whether too few landmarks were observed again to confirm the period. reobserved: as in `Evidence`."""
    return reobserved is not None and reobserved < options.min_reobserved


def moves_on(reobserved: int | None, reobservable: int) -> bool:
    """Whether most landmarks were not observed again at their position: the motion is not one rotation."""
    return reobserved is not None and reobserved < _MOST * reobservable


def rate_changes(slope: RateSlope, rate_hz: float, duration_s: float, options: VerdictOptions) -> bool:
    """Whether a slope of the rate is significant, and large enough to matter over the recording."""
    return (
        slope.significance > options.rate_slope_z and abs(slope.slope) * duration_s > options.max_rate_change * rate_hz
    )


def _doubts(evidence: Evidence, options: VerdictOptions) -> list[tuple[str, str]]:
    """Flag and reason of each sign that the motion is not the estimated one, the most serious first."""
    found = []
    motion, slope = evidence.rigidity, evidence.rate_slope
    if motion.axis_wander_z > options.rigidity_z and motion.axis_wander_deg > options.max_axis_wander_deg:
        found.append(
            (
                "not_a_rotation",
                f"not one rotation: the axis direction varies by {motion.axis_wander_deg:.2f} degrees or more",
            )
        )
    elif motion.closure_error_z > options.rigidity_z and motion.closure_error_px > options.max_closure_error_px:
        found.append(
            (
                "not_a_rotation",
                f"not one rotation: the image is {motion.closure_error_px:.2f} px off one revolution later",
            )
        )
    if rate_changes(slope, evidence.rate_hz, evidence.duration_s, options):
        found.append(
            (
                "rate_not_constant",
                f"the spin rate is not constant: it changes by {slope.slope:+.5f} +- {slope.std:.5f} Hz per second",
            )
        )
    if evidence.revolutions < options.min_revolutions:
        found.append(
            (
                "too_few_turns",
                f"only {evidence.revolutions:.2f} revolutions were observed; {options.min_revolutions:g} are needed "
                "to observe a landmark again",
            )
        )
    doubt = _axis_doubt(evidence, options)
    return [*found, ("axis_unobservable", doubt)] if doubt else found


def _axis_doubt(evidence: Evidence, options: VerdictOptions) -> str:
    if not np.isfinite(evidence.covariance.axis_cov).all():
        return ""
    std = float(np.degrees(np.sqrt(np.linalg.eigvalsh(evidence.covariance.axis_cov)[-1])))
    off_view = min(angle_between(evidence.axis, evidence.towards), angle_between(-evidence.axis, evidence.towards))
    if std > options.max_axis_std_deg or off_view < 3 * std:
        return (
            f"the axis is not observable: {off_view:.1f} degrees from the line of sight, "
            f"standard deviation {std:.1f} degrees"
        )
    return ""


def _failure(evidence: Evidence, options: VerdictOptions) -> tuple[str, str]:
    """Reason and flag of a failure; both empty for an estimate."""
    if evidence.points < options.min_points:
        return (
            f"only {evidence.points} landmarks follow one rotation; {options.min_points} are needed",
            "too_few_points",
        )
    if unconfirmed(evidence.reobserved, options):
        return (
            f"only {evidence.reobserved} landmarks were observed again one revolution later; "
            f"{options.min_reobserved} are needed",
            "",
        )
    if evidence.inliers < options.min_inliers:
        return (
            f"only {evidence.inliers:.0%} of the tracks follow one rotation; {options.min_inliers:.0%} are needed",
            "",
        )
    cov = evidence.covariance
    if not (np.isfinite(cov.rate_std_hz) and np.isfinite(cov.axis_cov).all()):
        return "the motion is not determined by the tracks (the factor graph is indeterminate)", ""
    if evidence.rate_hz <= 0 or cov.rate_std_hz > _RATE_STD_LIMIT * evidence.rate_hz:
        return f"the spin rate is not determined: {evidence.rate_hz:.4f} +- {cov.rate_std_hz:.4f} Hz", ""
    return "", ""
