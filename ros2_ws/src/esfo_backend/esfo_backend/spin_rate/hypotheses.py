"""Hypotheses of the spin rate, in the order in which they are evaluated."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from esfo_backend.errors import BackendError
from esfo_backend.options import BackendOptions
from esfo_backend.spin_rate.correlation import Harmonic, SpinRate, correlation_rate, fourier_rate
from esfo_backend.spin_rate.rate_ramp import RateRamp, find_rate_ramp
from esfo_backend.spin_rate.stream_rate import stream_rate
from esfo_backend.stopwatch import Stopwatch
from esfo_core.activity import Activity
from esfo_core.events import NS_PER_S

Kind = Literal["fourier", "period", "multiple", "ramp", "aperiodic"]

PreferredRates = Callable[[SpinRate], Sequence[float]]
"""Other rates in Hz than that of the event stream which the tracks fit better, the best first."""


@dataclass(frozen=True)
class Stream:
    """The event stream as counts: activity of all of it, and the levels of its pyramid, finest first, if it has one."""

    activity: Activity
    levels: Sequence[Activity] = ()


@dataclass(frozen=True)
class RateHypothesis:
    """A possible spin rate of the object.

    kind: `fourier` (the paper's rate, taken as it is), `period` (of the event stream), `multiple` (or fraction of that
    period), `ramp` (a rate that changes evenly) or `aperiodic` (no rate: reason and flags say why). rate: None for
    `aperiodic` alone. ramp: for `ramp` alone. alone: the stream has no period, so that nothing else explains it.
    """

    kind: Kind
    rate: SpinRate | None
    ramp: RateRamp | None = None
    reason: str = ""
    flags: tuple[str, ...] = ()
    alone: bool = False


def rate_hypotheses(
    stream: Stream, options: BackendOptions, watch: Stopwatch, preferred: PreferredRates, ramp_after_s: float
) -> Iterator[RateHypothesis]:
    """Yield the period of the event stream, then the hypotheses for tracks that one rotation at it does not explain.

    preferred: asked for the other rates that the tracks fit better. ramp_after_s: length of the stream in s from which
    a rate ramp is searched, which takes long.
    """
    if options.rate.method == "fourier":
        with watch.stage("spin_rate"):
            rate_hz = fourier_rate(stream.activity, options.rate.fourier_window_s)
        yield RateHypothesis("fourier", SpinRate(rate_hz, np.nan, np.nan, ()))
        return
    try:
        with watch.stage("spin_rate"):
            rate = _period(stream, options)
    except BackendError as error:
        yield _without_period(stream.activity, options, watch, ramp_after_s, error)
        return
    yield RateHypothesis("period", rate)
    equal = Harmonic(rate.rate_hz, rate.correlation, 0.0)
    for rate_hz in preferred(rate):
        harmonics = (equal, *(h for h in rate.harmonics if abs(h.rate_hz / rate_hz - 1) > 1e-6))
        yield RateHypothesis("multiple", replace(rate, rate_hz=rate_hz, harmonics=harmonics))
    with suppress(BackendError):  # a constant rate is no ramp
        ramp = _ramp(stream.activity, options, watch, ramp_after_s)
        if abs(ramp.slope) >= options.verdict.rate_slope_z * ramp.slope_std:
            yield RateHypothesis("ramp", ramp.rate, ramp)


def _period(stream: Stream, options: BackendOptions) -> SpinRate:
    """Rate at which the event stream repeats: at any resolution of the pyramid, or of the activity where there is none.

    Raises BackendError when it does not repeat.
    """
    if not stream.levels:
        return correlation_rate(stream.activity, options.rate)
    found = stream_rate(stream.levels)
    if not found.constant:
        raise BackendError(
            f"the rate changes by {100 * found.change:+.1f} % over {found.turns:.1f} revolutions", "rate_not_constant"
        )
    return SpinRate(found.rate_hz, found.correlation, np.nan, found.alternatives, found.rate_std_hz)


def _without_period(
    activity: Activity, options: BackendOptions, watch: Stopwatch, ramp_after_s: float, error: BackendError
) -> RateHypothesis:
    if "sensor_flicker" in error.flags:
        return RateHypothesis("aperiodic", None, reason=str(error), flags=error.flags, alone=True)
    try:
        ramp = _ramp(activity, options, watch, ramp_after_s)
    except BackendError:
        return RateHypothesis("aperiodic", None, reason=str(error), flags=error.flags, alone=True)
    return RateHypothesis("ramp", ramp.rate, ramp, alone=True)


def _ramp(activity: Activity, options: BackendOptions, watch: Stopwatch, ramp_after_s: float) -> RateRamp:
    if (activity.end - activity.t0) / NS_PER_S < ramp_after_s:
        raise BackendError("no rate ramp was searched")
    with watch.stage("spin_rate"):
        return find_rate_ramp(activity, options.rate)
