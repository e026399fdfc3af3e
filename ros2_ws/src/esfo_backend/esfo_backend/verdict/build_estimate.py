"""From an optimum to an estimate: deviations, what speaks against it, and the verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from esfo_backend.adjustment.covariance import motion_covariance
from esfo_backend.adjustment.factor_graph import GraphResult
from esfo_backend.initialise.initialisation import Start
from esfo_backend.landmarks.landmarks import Structure, recurring_points, repeatable_points
from esfo_backend.landmarks.reidentification import point_rms
from esfo_backend.options import BackendOptions
from esfo_backend.orbit.parametrization import spin_and_points
from esfo_backend.orbit.projection import row_errors
from esfo_backend.spin_rate.correlation import SpinRate
from esfo_backend.spin_rate.rate_ramp import ChangingRate
from esfo_backend.verdict.rate_slope import RateDrift, rate_drift
from esfo_backend.verdict.rigidity import constancy, widened
from esfo_backend.verdict.verdict import Evidence, judge, moves_on
from esfo_core.estimate import Alternative, OrbitEstimate
from esfo_core.orbit import NANOSECONDS


@dataclass(frozen=True)
class Optimum:
    """Optimum of the factor graph and what it came from.

    structure: tracks, points and motion. result: of the optimisation. rate: of the event stream. span: begin and end of
    the data, ns. changing: the course of a rate that changes, None for a constant one.
    """

    structure: Structure
    result: GraphResult
    rate: SpinRate
    start: Start
    span: tuple[int, int]
    changing: ChangingRate | None = None

    @property
    def duration_s(self) -> float:
        """Duration of the data in s."""
        return (self.span[1] - self.span[0]) / NANOSECONDS

    @property
    def revolutions(self) -> float:
        """Turns that were seen."""
        return self.structure.solution.motion.rate_hz * self.duration_s


def appraise(optimum: Optimum, options: BackendOptions, timing_s: dict[str, float]) -> OrbitEstimate:
    """Judge an optimum and put the estimate together. timing_s: seconds of each stage so far."""
    structure = optimum.structure
    solution, obs, motion = structure.solution, structure.obs, structure.solution.motion
    evidence = _evidence(optimum, options)
    verdict = judge(evidence, options.verdict)
    inliers = structure.label >= 0
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
    turns_rad = optimum.revolutions / (2 * float(obs.rows.focal.mean()))
    covariance = widened(
        evidence.covariance, evidence.constancy, motion.rate_hz, turns_rad, options.verdict.constancy_z
    )
    t0 = optimum.changing.middle if optimum.changing else optimum.span[0]
    spin, points = spin_and_points(motion, solution.y, obs.t_ref, t0)
    errors = row_errors(motion.Q, motion.rate_hz, solution.y, obs.rows)
    return OrbitEstimate(
        status=verdict.status,
        reason=verdict.reason,
        spin=spin,
        rate_std_hz=covariance.rate_std_hz,
        axis_cov=covariance.axis_cov,
        points=points,
        point_rms_px=point_rms(errors, obs),
        point_rows=np.diff(obs.rows.first),
        revolutions=optimum.revolutions,
        rms_px=float(np.sqrt(np.mean(errors**2))),
        initialisation=optimum.start.name,
        rate_slope_hz_s=evidence.drift.slope,
        rate_slope_std_hz_s=evidence.drift.std,
        **known,
    )


def recurring(structure: Structure, options: BackendOptions) -> int | None:
    """Points seen again, None where nobody looked for them."""
    if not options.reidentification.enabled:
        return None
    return recurring_points(structure.obs, structure.solution.motion.rate_hz)


def most_recur(structure: Structure, options: BackendOptions) -> bool:
    """Whether most points came round again."""
    repeatable = repeatable_points(structure.obs, structure.solution.motion.rate_hz)
    return not moves_on(recurring(structure, options), repeatable)


def _evidence(optimum: Optimum, options: BackendOptions) -> Evidence:
    """Gather what the verdict looks at."""
    structure, rate = optimum.structure, optimum.rate
    solution, obs, motion = structure.solution, structure.obs, structure.solution.motion
    noise = (options.graph.cauchy_px, options.graph.bias_px)
    covariance = motion_covariance(solution, obs, optimum.result.marginal, *noise)
    drift = rate_drift(solution, obs, *noise)
    if optimum.changing:
        bend = optimum.changing.bend
        drift = RateDrift(
            bend * motion.rate_hz + drift.slope, float(np.hypot(drift.std, bend * covariance.rate_std_hz))
        )
    return Evidence(
        rate_hz=motion.rate_hz,
        axis=motion.axis,
        towards=motion.Q @ np.array([-1.0, 0.0, np.median(solution.y[:, 2])]),
        covariance=covariance,
        points=obs.points,
        recurring=recurring(structure, options),
        repeatable=repeatable_points(obs, motion.rate_hz),
        inliers=float((structure.label >= 0).mean()),
        alternatives=_alternatives(rate, optimum.start),
        harmonic_z=min((h.z for h in rate.harmonics if h.rate_hz > rate.rate_hz), default=np.inf),
        drift=drift,
        constancy=constancy(solution, obs, *noise),
        revolutions=optimum.revolutions,
        duration_s=optimum.duration_s,
    )


def _alternatives(rate: SpinRate, start: Start) -> tuple[Alternative, ...]:
    found = [
        Alternative("harmonic", h.rate_hz, np.zeros(3), rate.correlation / max(h.correlation, 1e-9))
        for h in rate.harmonics
        if h.correlation > 0.1 * rate.correlation
    ]
    if start.second is not None:
        ratio = start.second.cost / max(start.adjusted.cost, 1e-12)
        mirrored = start.second.motion.axis @ start.adjusted.motion.axis < 0
        found.append(
            Alternative("mirror" if mirrored else "axis", start.second.motion.rate_hz, start.second.motion.axis, ratio)
        )
    return tuple(found)
