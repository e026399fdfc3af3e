"""The result of a run in lines for a person."""

from __future__ import annotations

from esfo_bringup.offline.pipeline import RunResult


def summary(result: RunResult) -> list[str]:
    """Lines that say the result to a person."""
    e = result.estimate
    lines = []
    if e.spin is not None:
        x, y, z = e.spin.axis
        lines += [
            f"spin rate   {e.spin.rate_hz:.6f} Hz +- {e.rate_std_hz:.6f}  ({60 * e.spin.rate_hz:.3f} rpm)",
            f"axis        ({x:+.4f}, {y:+.4f}, {z:+.4f}) +- {e.axis_std_deg:.3f} deg, camera frame",
            f"structure   {len(e.points)} points from {e.tracks} tracks, {e.observations} observations, "
            f"{e.revolutions:.2f} turns, {e.rms_px:.2f} px RMS",
            f"start       {e.initialisation} ({result.note})" if result.note else f"start       {e.initialisation}",
        ]
    return [*lines, f"status      {e.status}" + (f" [{', '.join(e.flags)}]" if e.flags else "")]
