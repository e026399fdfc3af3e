"""An estimate as text: one line for logs and progress, named facts for the terminal and the report."""

from __future__ import annotations

import math

from esfo_core.estimate import OrbitEstimate

_PRINTED = ("spin rate", "axis", "structure", "initialised", "status")


def one_line(estimate: OrbitEstimate, points: int | None = None) -> str:
    """Return an estimate in one line.

    points: number of its points, for an estimate that was received without them.
    """
    if estimate.level == "none":
        return f"{estimate.status}: {estimate.reason}"
    if estimate.spin is None:
        return (
            f"{estimate.status}, rate alone: {estimate.rate_hz:.6g} +- {estimate.rate_std_hz:.2g} Hz; {estimate.reason}"
        )
    axis = ", ".join(f"{v:.4f}" for v in estimate.spin.axis)
    flags = f" ({', '.join(estimate.flags)})" if estimate.flags else ""
    number = len(estimate.points) if points is None else points
    return (
        f"{estimate.status}{flags}: {estimate.spin.rate_hz:.5f} +- {estimate.rate_std_hz:.5f} Hz, "
        f"axis [{axis}] +- {estimate.axis_std_deg:.2f} deg, {number} points, {estimate.rms_px:.2f} px"
    )


def facts(estimate: OrbitEstimate, note: str = "") -> dict[str, str]:
    """Return what an estimate says, by name: `status` always, the other facts where there is a motion.

    note: remark on the initialisation, such as why COLMAP was not used.
    """
    status = estimate.status + (f" [{', '.join(estimate.flags)}]" if estimate.flags else "")
    spin = estimate.spin
    if estimate.level == "none":
        return {"status": status}
    rate = f"{estimate.rate_hz:.6f} Hz +- {estimate.rate_std_hz:.6f}  ({60 * estimate.rate_hz:.3f} rpm)"
    if spin is None:
        return {"spin rate": f"{rate}, from the event stream alone", "status": status}
    axis, center = (", ".join(f"{v:+.4f}" for v in vector) for vector in (spin.axis, spin.center))
    found = {"spin rate": rate}
    if math.isfinite(estimate.rate_slope_hz_s):
        found["rate slope"] = f"{estimate.rate_slope_hz_s:+.2e} Hz/s +- {estimate.rate_slope_std_hz_s:.1e}"
    return {
        **found,
        "axis": f"({axis}) +- {estimate.axis_std_deg:.3f} deg, camera frame",
        "centre": f"({center}), in {'orbit radii' if estimate.scale == 'unit' else 'metres'}",
        "structure": (
            f"{len(estimate.points)} points from {estimate.tracks} tracks, {estimate.observations} observations, "
            f"{estimate.revolutions:.2f} turns, {estimate.rms_px:.2f} px RMS"
        ),
        "initialised": f"by {estimate.initialisation}" + (f" ({note})" if note else ""),
        "status": status,
    }


def printed_facts(estimate: OrbitEstimate, note: str = "") -> list[str]:
    """Return the facts that a command prints, one line each; `note` as of `facts`."""
    named = facts(estimate, note)
    return [f"{name:<12}{named[name]}" for name in _PRINTED if name in named]
