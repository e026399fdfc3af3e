"""Evaluation of an optimum: covariances, evidence and verdict, and the estimate made from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from esfo_backend.adjustment.covariance import motion_covariance
from esfo_backend.adjustment.factor_graph import GraphOptimum
from esfo_backend.initialise.initialisation import Initialisation
from esfo_backend.initialise.rate_evidence import RateComparison
from esfo_backend.landmarks.landmarks import Landmarks, reobservable_points, reobserved_points
from esfo_backend.landmarks.reidentification import point_rms
from esfo_backend.options import BackendOptions, VerdictOptions
from esfo_backend.orbit.parametrization import spin_and_points
from esfo_backend.orbit.projection import row_errors
from esfo_backend.spin_rate.correlation import SpinRate
from esfo_backend.spin_rate.rate_ramp import RateRamp
from esfo_backend.verdict.rate_slope import RateSlope, rate_slope
from esfo_backend.verdict.rigidity import rigidity, widened
from esfo_backend.verdict.verdict import Evidence, judge, moves_on
from esfo_core.camera import Camera
from esfo_core.estimate import Alternative, OrbitEstimate, RateEstimate
from esfo_core.events import NS_PER_S

_RULED_OUT_Z = 3.0

_OTHER_MOTION = {"not_a_rotation", "rate_not_constant"}
"""Flags of a failed estimate that are positive evidence of another motion than a rotation at one rate."""


@dataclass(frozen=True)
class Optimum:
    """Optimum of the factor graph and the data that it was computed from.

    landmarks: tracks, points and motion. result: of the optimisation. rate: of the event stream. span: begin and end of
    the data, ns. ramp: None for a constant rate. camera: the one that it is for, None for a calibrated one.
    """

    landmarks: Landmarks
    result: GraphOptimum
    rate: SpinRate
    initialisation: Initialisation
    span: tuple[int, int]
    ramp: RateRamp | None = None
    camera: Camera | None = None

    @property
    def focal_std(self) -> float:
        """Standard deviation of the focal length, relative; 0 for a calibrated camera."""
        return 0.0 if self.camera is None else self.camera.focal_std

    @property
    def duration_s(self) -> float:
        """Duration of the data in s."""
        return (self.span[1] - self.span[0]) / NS_PER_S

    @property
    def revolutions(self) -> float:
        """Number of observed revolutions."""
        return self.landmarks.solution.motion.rate_hz * self.duration_s


def build_estimate(optimum: Optimum, options: BackendOptions, timing_s: dict[str, float]) -> OrbitEstimate:
    """Evaluate an optimum and return the estimate. timing_s: seconds of each stage so far."""
    landmarks = optimum.landmarks
    solution, obs, motion = landmarks.solution, landmarks.obs, landmarks.solution.motion
    evidence = _evidence(optimum, options)
    verdict = judge(evidence, options.verdict)
    inliers = landmarks.label >= 0
    known: dict[str, Any] = {
        "flags": verdict.flags,
        "tracks": int(inliers.sum()),
        "observations": len(obs.rows.dt),
        "t_first": optimum.span[0],
        "t_last": optimum.span[1],
        "alternatives": evidence.alternatives,
        "timing_s": timing_s,
    }
    if verdict.status == "failed":
        return OrbitEstimate.failure(verdict.reason, **known)
    rad_per_px = optimum.revolutions / (2 * float(obs.rows.focal.mean()))
    covariance = widened(evidence.covariance, evidence.rigidity, motion.rate_hz, rad_per_px, options.verdict.rigidity_z)
    t0 = optimum.ramp.middle if optimum.ramp else optimum.span[0]
    spin, points = spin_and_points(motion, solution.y, obs.t_ref, t0)
    errors = row_errors(motion.Q, motion.rate_hz, solution.y, obs.rows)
    return OrbitEstimate(
        status=verdict.status,
        reason=verdict.reason,
        spin=spin,
        level="image_axis" if "axis_unobservable" in verdict.flags else "orbit",
        rate_hz=spin.rate_hz,
        rate_std_hz=covariance.rate_std_hz,
        axis_cov=covariance.axis_cov,
        points=points,
        point_rms_px=point_rms(errors, obs),
        point_observations=np.diff(obs.rows.first),
        revolutions=optimum.revolutions,
        rms_px=float(np.sqrt(np.mean(errors**2))),
        initialisation=optimum.initialisation.name,
        track_rate=None if optimum.ramp else evidence.rigidity.track_rate(motion.rate_hz),
        rate_slope_hz_s=evidence.rate_slope.slope,
        rate_slope_std_hz_s=evidence.rate_slope.std,
        focal_px=optimum.camera.focal_px if optimum.camera and optimum.focal_std else np.nan,
        focal_std_px=optimum.camera.focal_px * optimum.focal_std if optimum.camera and optimum.focal_std else np.nan,
        **known,
    )


def reobserved(landmarks: Landmarks, options: BackendOptions) -> int | None:
    """Number of landmarks observed again one revolution later; None without re-identification."""
    if not options.reidentification.enabled:
        return None
    return reobserved_points(landmarks.obs, landmarks.solution.motion.rate_hz)


def most_reobserved(landmarks: Landmarks, options: BackendOptions) -> bool:
    """Whether most landmarks were observed again one revolution later."""
    reobservable = reobservable_points(landmarks.obs, landmarks.solution.motion.rate_hz)
    return not moves_on(reobserved(landmarks, options), reobservable)


def _evidence(optimum: Optimum, options: BackendOptions) -> Evidence:
    """Compute the statistics that the verdict is based on."""
    landmarks, rate = optimum.landmarks, optimum.rate
    solution, obs, motion = landmarks.solution, landmarks.obs, landmarks.solution.motion
    noise = (options.graph.cauchy_px, options.graph.bias_px)
    covariance = motion_covariance(solution, obs, optimum.result.marginal, *noise, optimum.focal_std)
    rate_change = rate_slope(solution, obs, *noise)
    if optimum.ramp:
        slope = optimum.ramp.relative_slope
        rate_change = RateSlope(
            slope * motion.rate_hz + rate_change.slope,
            float(np.hypot(rate_change.std, slope * covariance.rate_std_hz)),
            rate_change.widened,
        )
    return Evidence(
        rate_hz=motion.rate_hz,
        axis=motion.axis,
        towards=motion.Q @ np.array([-1.0, 0.0, np.median(solution.y[:, 2])]),
        covariance=covariance,
        points=obs.points,
        reobserved=reobserved(landmarks, options),
        reobservable=reobservable_points(obs, motion.rate_hz),
        inliers=float((landmarks.label >= 0).mean()),
        alternatives=_alternatives(rate, optimum.initialisation),
        harmonic_z=_harmonic_z(rate),
        rate_slope=rate_change,
        rigidity=rigidity(solution, obs, *noise),
        revolutions=optimum.revolutions,
        duration_s=optimum.duration_s,
    )


def _harmonic_z(rate: SpinRate) -> float:
    """Significance with which the stream rules out the least unlikely fraction of its period.

    A stream of which all resolutions were searched states it for few revolutions, too: 3 are enough there, and the
    tracks are compared at other rates besides.
    """
    z = min((h.z for h in rate.harmonics if h.rate_hz > rate.rate_hz), default=np.inf)
    return np.inf if np.isfinite(rate.rate_std_hz) and z > _RULED_OUT_Z else z


def _alternatives(rate: SpinRate, initialisation: Initialisation) -> tuple[Alternative, ...]:
    found = [
        Alternative("harmonic", h.rate_hz, np.zeros(3), rate.correlation / max(h.correlation, 1e-9))
        for h in rate.harmonics
        if h.correlation > 0.1 * rate.correlation
    ]
    if initialisation.second is not None:
        ratio = initialisation.second.cost / max(initialisation.solution.cost, 1e-12)
        mirrored = initialisation.second.motion.axis @ initialisation.solution.motion.axis < 0
        found.append(
            Alternative(
                "mirror" if mirrored else "axis",
                initialisation.second.motion.rate_hz,
                initialisation.second.motion.axis,
                ratio,
            )
        )
    return tuple(found)


def with_axis_comparison(estimate: OrbitEstimate, z: float, options: VerdictOptions) -> OrbitEstimate:
    """Return the estimate, degenerate where the tracks do not prefer its axis to the next best one by `rate_z`.

    z: by how many standard errors they do. The rate, and for a mirrored axis its image, hold all the same; the other
    axis is among the alternatives.
    """
    if estimate.spin is None or z >= options.rate_z:
        return estimate
    flags = estimate.flags if "mirror_ambiguous" in estimate.flags else (*estimate.flags, "mirror_ambiguous")
    reason = (
        f"the tracks do not tell two axes apart: they fit the one better by {z:.1f} standard errors, "
        f"{options.rate_z:g} are needed"
    )
    return replace(estimate, status="degenerate", level="image_axis", flags=flags, reason=estimate.reason or reason)


def with_comparisons(
    estimate: OrbitEstimate, comparisons: Sequence[RateComparison], options: VerdictOptions
) -> OrbitEstimate:
    """Return the estimate with the other rates that the tracks were compared at.

    A rate that the tracks do not prefer to each of them by `options.rate_z` is not certain: the estimate becomes
    degenerate, with the others among its alternatives.
    """
    close = [c for c in comparisons if c.z < options.rate_z]
    if not close or estimate.spin is None:
        return estimate
    known = {round(a.rate_hz, 9) for a in estimate.alternatives}
    added = [Alternative("harmonic", c.rate_hz, np.zeros(3), c.cost_ratio) for c in close]
    flags = estimate.flags if "harmonic_ambiguous" in estimate.flags else (*estimate.flags, "harmonic_ambiguous")
    nearest = min(close, key=lambda c: c.z)
    reason = (
        f"the tracks do not tell {estimate.rate_hz:.5g} Hz from {nearest.rate_hz:.5g} Hz: they fit the one better by "
        f"{nearest.z:.1f} standard errors, {options.rate_z:g} are needed"
    )
    return replace(
        estimate,
        status="degenerate",
        flags=flags,
        reason=estimate.reason or reason,
        alternatives=(*estimate.alternatives, *(a for a in added if round(a.rate_hz, 9) not in known)),
    )


def with_stream_rate(estimate: OrbitEstimate, stream: SpinRate | None) -> OrbitEstimate:
    """Return the estimate with the rate of the event stream beside it.

    A failed estimate becomes one of the rate alone, unless its tracks show that the motion is none that repeats: the
    stream's rate needs no tracks.
    """
    if stream is None or not np.isfinite(stream.rate_std_hz):
        return estimate
    rate = RateEstimate(stream.rate_hz, stream.rate_std_hz)
    estimate = replace(estimate, stream_rate=rate)
    if estimate.status != "failed" or _OTHER_MOTION & set(estimate.flags):
        return estimate
    return replace(
        estimate,
        status="degenerate",
        level="rate",
        flags=(*(f for f in estimate.flags if f != "too_few_turns"), "axis_unobservable", "scale_unobservable"),
        reason=f"the event stream repeats, but the tracks do not show the axis: {estimate.reason}",
        rate_hz=rate.rate_hz,
        rate_std_hz=rate.std_hz,
        revolutions=rate.rate_hz * (estimate.t_last - estimate.t_first) / NS_PER_S,
        alternatives=tuple(
            Alternative("harmonic", h.rate_hz, np.zeros(3), stream.correlation / max(h.correlation, 1e-9))
            for h in stream.harmonics
            if h.correlation > 0.1 * stream.correlation
        ),
    )
