"""Tables of the results of `orbit_accuracy`, as in docs/benchmarks.md."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from esfo_bringup.benchmark.orbit_accuracy import OrbitResult

HEADER = (
    "| scene | preset | verdict | rate, % | axis, deg | screw line, px | error/std: rate, axis | COLMAP: views, px "
    "| RMS, px | before, % | after, % | points | seconds |",
    "|---|---|---|---|---|---|---|---|---|---|---|---|---|",
)


def row_of(r: OrbitResult) -> str:
    """Return the row of one scene."""
    e = r.estimate
    flags = ", ".join(f for f in e.flags if f != "scale_unobservable")
    verdict = f"{e.status} {f'[{flags}]' if flags else ''} {e.reason}".strip()
    return (
        f"| {r.scene} | {r.preset} | {verdict} | {r.rate_percent:.4f} | {r.axis_deg:.3f} | {r.screw_px:.2f} "
        f"| {r.z_rate:.1f}, {r.z_axis:.1f} | {r.colmap} | {e.rms_px:.2f} | {r.before[0]:.2f} ({r.before[1]:.2f}) "
        f"| {r.after[0]:.2f} ({r.after[1]:.2f}) | {len(e.points)} | {r.seconds[0]:.1f} + {r.seconds[1]:.1f} |"
    )


@dataclass(frozen=True)
class Measure:
    """A quantity of each result. goal: for the median (for the worst). of_all: also of results that are not `ok`."""

    name: str
    get: Callable[[OrbitResult], float]
    goal: str = ""
    of_all: bool = False


MEASURES = (
    Measure("rate error, %", lambda r: r.rate_percent, "0.002 (0.02)"),
    Measure("axis error, deg", lambda r: r.axis_deg, "0.1 (0.5)"),
    Measure("screw line, px", lambda r: r.screw_px),
    Measure("registration, before, %", lambda r: r.before[0]),
    Measure("registration, after, %", lambda r: r.after[0], "1"),
    Measure("front-end, CPU s", lambda r: r.seconds[0], of_all=True),
    Measure("back-end, s", lambda r: r.seconds[1], of_all=True),
)


@dataclass(frozen=True)
class Summary:
    """Statistics of the results under one preset.

    statuses: number of results by status. spread: median and largest finite value of each measure by name, None where
    there is none. covered: share of the `ratios` errors of rate and axis below three standard deviations.
    """

    preset: str
    statuses: dict[str, int]
    spread: dict[str, tuple[float, float] | None]
    covered: float | None
    ratios: int

    def lines(self) -> list[str]:
        """Return the table, with the goals."""
        counts = ", ".join(f"{count} {status}" for status, count in self.statuses.items())
        rows = []
        for measure in MEASURES:
            spread = self.spread[measure.name]
            here = "-" if spread is None else f"{spread[0]:.4g} ({spread[1]:.4g})"
            rows.append(f"| {measure.name} | {here} | {measure.goal} |")
        covered = "-" if self.covered is None else f"{self.covered:.1%} of {self.ratios}"
        return [
            f"{self.preset}: {counts}; median (worst) of those ok",
            "| | here | goal |",
            "|---|---|---|",
            *rows,
            f"| error over its std below 3 | {covered} | 97 % |",
        ]

    def to_json(self) -> dict[str, object]:
        """Return the statistics by name; None stands for values that do not exist."""
        spread = {name: None if s is None else {"median": s[0], "worst": s[1]} for name, s in self.spread.items()}
        return {
            "preset": self.preset,
            "statuses": self.statuses,
            **spread,
            "share below 3 std": self.covered,
        }


def summarise(results: Sequence[OrbitResult], preset: str) -> Summary:
    """Summarise; errors are those of results with status `ok`, because only these are claimed to be accurate."""
    own = [r for r in results if r.preset == preset]
    ok = [r for r in own if r.estimate.status == "ok"]
    z = np.array([v for r in ok for v in (r.z_rate, r.z_axis)])
    return Summary(
        preset,
        {status: sum(r.estimate.status == status for r in own) for status in ("ok", "degenerate", "failed")},
        {m.name: _spread([m.get(r) for r in (own if m.of_all else ok)]) for m in MEASURES},
        float(np.mean(z < 3)) if len(z) else None,
        len(z),
    )


def _spread(values: Sequence[float]) -> tuple[float, float] | None:
    finite = np.array(values)[np.isfinite(values)]
    return (float(np.median(finite)), float(finite.max())) if len(finite) else None
