"""The rate from the event stream alone: at any rate, without tracks, calibration or an option of time.

What repeats is looked for at all resolutions, verified where most turns are seen, and measured by least squares. There
is a rate only where the stream repeats as a rotation does; otherwise an error names what was seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from esfo_backend.errors import BackendError
from esfo_backend.spin_rate.correlation import LARGEST_HARMONIC, Harmonic
from esfo_backend.spin_rate.flicker import Flicker, find_flicker, is_light, without
from esfo_backend.spin_rate.level_features import Correlation, Features, correlate, features_of_level, masks_of
from esfo_backend.spin_rate.period_refinement import Refined, class_difference, fold, refine
from esfo_backend.spin_rate.period_search import LEAST_SIGNAL, VERIFY_BINS, Candidate, candidates, verify
from esfo_backend.spin_rate.steady_stretch import cut, steady_stretch
from esfo_core.activity import Activity
from esfo_core.events import NS_PER_S

FEWEST_EVENTS = 500
"""Events below which counting noise hides any period."""
_REPEATS, _HEIGHT = 0.6, 0.4
"""Least correlation, free of counting noise, and height over the valleys of what repeats at all."""
STEADY = 0.85
"""Least correlation of a steady rotation (docs/method.md: how rotations and other motion are distributed)."""
_FEWEST_BINS = 12
"""Of a period that is measured."""
_WITHIN, _LEAST_WITHIN = 3.0, 0.03
"""The shortest period is taken whose mismatch is below so many times that of the best, or this."""
_CLASS_Z = 6.0
"""Significance with which every k-th turn must differ from the others for k of them to be the period."""
_PART_Z = 3.0
"""Significance below which the turns of a shorter period are alike."""
_SLOPE_Z, _SLOPE_SHARE = 4.0, 0.005
"""Significance of a change of the rate, and the least relative one over the stretch, that is told."""


class NoRateError(BackendError):
    """The stream gives no rate.

    reason: `too_few_events`, `no_repetition`, `too_few_turns`, `sensor_flicker` or `rate_not_constant`, also the only
    flag. flicker: what was found of it.
    """

    def __init__(self, reason: str, message: str, flicker: Flicker | None = None) -> None:
        super().__init__(message, reason)
        self.reason, self.flicker = reason, flicker


@dataclass(frozen=True)
class StreamRate:
    """The rate at which the event stream repeats.

    rate_hz, rate_std_hz: of the stretch [begin, end) ns, the longest steady one where `whole` is False. correlation: of
    activity one period apart, freed of counting noise. bin: ns, the resolution in use. turns: seen in the stretch.
    alternatives: other periods, best first; z: significance with which the stream rules them out. change: of the rate
    over the stretch, relative, and change_std. flicker: light that was found beside it, None: none.
    """

    rate_hz: float
    rate_std_hz: float
    correlation: float
    bin: int
    turns: float
    begin: int
    end: int
    whole: bool
    alternatives: tuple[Harmonic, ...]
    change: float
    change_std: float
    flicker: Flicker | None

    @property
    def constant(self) -> bool:
        """False where the rate changes significantly and by more than a small part over the stretch."""
        return abs(self.change) < max(_SLOPE_Z * self.change_std, _SLOPE_SHARE)


def stream_rate(levels: Sequence[Activity]) -> StreamRate:
    """Find the rate from the levels of an activity pyramid, finest first. Raises NoRateError where there is none."""
    events = max((int(level.counts.sum(dtype=np.int64)) for level in levels), default=0)
    if events < FEWEST_EVENTS:
        raise NoRateError("too_few_events", f"{events} events are too few to look for a period")
    features = [features_of_level(*pair) for pair in zip(levels, masks_of(levels), strict=True)]
    flicker = find_flicker(features)
    if flicker is not None:
        features = [without(level, flicker) for level in features]
    correlations = [correlate(level) for level in features]
    found = [c for c in candidates(correlations, features) if _repeats(c)]
    found = [c for c in found if not is_light(features[c.level], c.lag, flicker)]
    if not found:
        raise _nothing(features, correlations, flicker)
    chosen = _shortest(found)
    chosen = _divided(features, correlations, chosen)
    best = _measure(features, chosen, flicker, found)
    if best is None:
        raise NoRateError(
            "rate_not_constant" if chosen.turns >= 2 else "too_few_turns",
            f"the event stream repeats at about {1 / chosen.period_s:.4g} Hz, but not well enough for a rotation at a "
            f"constant rate (correlation {chosen.true_r:.2f} over {chosen.turns:.1f} turns)",
            flicker,
        )
    return best


def _repeats(c: Candidate) -> bool:
    return c.true_r >= _REPEATS and c.height >= _HEIGHT * c.r / c.true_r


def _shortest(found: list[Candidate]) -> Candidate:
    worst = _WITHIN * max(1 - max(c.true_r for c in found), _LEAST_WITHIN)
    return next(c for c in found if 1 - c.true_r < worst)


def _divided(features: Sequence[Features], correlations: Sequence[Correlation], chosen: Candidate) -> Candidate:
    """A part of the period after which the stream looks the same but for noise; the period itself where there is none.

    On finer levels noise may hide from a search what many turns together show.
    """
    for k in range(LARGEST_HARMONIC, 1, -1):
        part = verify(correlations, features, chosen.period_s / k * NS_PER_S)
        if part is None or part.true_r < _REPEATS or part.turns < 4 * k:
            continue
        level = features[part.level]
        refined = refine(level, part.lag)
        if part.height < _HEIGHT * level.signal or refined is None or abs(refined.lag / part.lag - 1) > 0.02:
            continue
        if class_difference(fold(level, refined.lag), k) < _PART_Z:
            return part
    return chosen


def _nothing(features: Sequence[Features], correlations: Sequence[Correlation], flicker: Flicker | None) -> NoRateError:
    if flicker is not None:
        return NoRateError("sensor_flicker", f"nothing but light that flickers at {flicker} repeats", flicker)
    if max(level.signal for level in features) < 0.1:
        return NoRateError("too_few_events", "the events are so few that their activity is mostly counting noise")
    return NoRateError("no_repetition", "the event stream does not repeat")


def _measure(
    features: Sequence[Features], chosen: Candidate, flicker: Flicker | None, found: list[Candidate]
) -> StreamRate | None:
    """Rate of the longest steady stretch at a period, at the level that tells it best; None: there is none."""
    best: tuple[Features, Refined, float] | None = None
    whole = True
    for number in (chosen.level, chosen.level - 1, chosen.level + 1):
        if not 0 <= number < len(features):
            continue
        level = features[number]
        lag = chosen.period_s * NS_PER_S / level.bin
        if number > chosen.level and (best is not None or lag < _FEWEST_BINS):
            continue  # coarser bins, of which more events are, where finer ones are too noisy
        stretch = steady_stretch(level, lag)
        if stretch is None:
            continue
        part = cut(level, *stretch)
        refined = refine(part, lag)
        if refined is None or len(part.rows) < (1.0 + 0.05) * refined.lag:
            continue
        r = _correlation_at(part, refined.lag)
        if r < STEADY:
            continue
        if best is None or _relative(refined) < _relative(best[1]):
            best, whole = (part, refined, r), len(part.rows) == len(level.rows)
    if best is None:
        return None
    part, refined, r = best
    classes, differences = _period_of_classes(part, refined)
    if classes > 1:
        again = refine(part, classes * refined.lag)
        refined = again or refined
        r = max(r, _correlation_at(part, refined.lag))
    rate = NS_PER_S / part.bin / refined.lag
    change, change_std = _change(refined)
    return StreamRate(
        rate_hz=rate,
        rate_std_hz=rate * _relative(refined),
        correlation=r,
        bin=part.bin,
        turns=len(part.rows) / refined.lag,
        begin=part.t0,
        end=part.end,
        whole=whole,
        alternatives=_alternatives(part, refined, found, differences if classes == 1 else {}),
        change=change,
        change_std=change_std,
        flicker=flicker,
    )


def _relative(refined: Refined) -> float:
    return refined.lag_std / refined.lag


def _correlation_at(part: Features, lag: float) -> float:
    """Correlation of activity a period apart, freed of counting noise."""
    r = correlate(part).r
    at = round(lag)
    if at >= len(r) - 1:
        return 0.0
    near = r[max(at - 1, 0) : at + 2]
    return min(float(np.nanmax(near, initial=0.0)) / max(part.signal, LEAST_SIGNAL), 1.0)


def _period_of_classes(part: Features, refined: Refined) -> tuple[int, dict[int, float]]:
    """How many of these turns make one: the fewest whose classes differ significantly; and all significances."""
    folded = fold(part, refined.lag)
    differences = {k: class_difference(folded, k) for k in range(2, LARGEST_HARMONIC + 1)}
    return next((k for k, z in differences.items() if z > _CLASS_Z), 1), differences


def _alternatives(
    part: Features, refined: Refined, found: list[Candidate], differences: dict[int, float]
) -> tuple[Harmonic, ...]:
    """Multiples and parts of the rate, and other periods that repeat, by their correlation."""
    rate = NS_PER_S / part.bin / refined.lag
    correlation = correlate(part)
    r = correlation.r
    others: list[Harmonic] = []
    for k in range(2, LARGEST_HARMONIC + 1):
        slow, fast = k * refined.lag, refined.lag / k
        if slow < len(r) - 1 and np.isfinite(r[round(slow)]):
            others.append(
                Harmonic(rate / k, float(r[round(slow)]) / max(part.signal, LEAST_SIGNAL), -differences.get(k, 0.0))
            )
        if fast >= VERIFY_BINS / 4:
            value = float(np.interp(fast, np.arange(len(r)), r)) / max(part.signal, LEAST_SIGNAL)
            others.append(Harmonic(k * rate, value, _worse_by(refined, correlation, value)))
    known = [o.rate_hz for o in others] + [rate]
    for c in found:
        if all(abs(c.period_s * hz - 1) > 0.03 for hz in known):
            others.append(Harmonic(1 / c.period_s, c.true_r, 0.0))
    return tuple(sorted((o for o in others if o.correlation > 0), key=lambda o: -o.correlation))


def _worse_by(refined: Refined, correlation: Correlation, value: float) -> float:
    """Standard deviations by which a shorter period correlates less, from the turns that are independent."""
    turns = max(len(correlation.r) / refined.lag - 1, 1.0)
    spread = np.sqrt(max(1 - value**2, 1e-6) / (turns * min(refined.lag / 3, 30.0)))
    best = float(correlation.r[min(round(refined.lag), len(correlation.r) - 1)]) / max(correlation.signal, LEAST_SIGNAL)
    return float((min(best, 1.0) - value) / spread)


def _change(refined: Refined) -> tuple[float, float]:
    """Relative change of the rate over the turns, and its standard deviation, from a parabola through the delays."""
    seen = np.isfinite(refined.delays) & (refined.delay_std > 0)
    n = np.arange(len(refined.delays))[seen] - len(refined.delays) / 2
    if len(n) < 4:
        return 0.0, np.inf
    design = np.stack([np.ones_like(n), n, n**2], axis=1)
    weight = 1 / refined.delay_std[seen]
    covariance = np.linalg.inv((design * weight[:, None] ** 2).T @ design)
    fitted = covariance @ (design * weight[:, None] ** 2).T @ refined.delays[seen]
    scatter = (refined.delays[seen] - design @ fitted) * weight
    wider = max(float(np.sqrt((scatter**2).sum() / max(len(n) - 3, 1))), 1.0)
    # Turn n is late by q n^2 bins: the period grows by 2 q bins a turn.
    over_all = 2 * len(refined.delays) / refined.lag
    return float(-fitted[2] * over_all), float(np.sqrt(covariance[2, 2]) * wider * over_all)
