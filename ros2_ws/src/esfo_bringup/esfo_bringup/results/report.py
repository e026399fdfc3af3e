"""The report of a run: one HTML file that needs nothing beside it."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from html import escape
from pathlib import Path

from esfo_bringup.offline.pipeline import RunResult
from esfo_bringup.offline.source import Source
from esfo_core.estimate import OrbitEstimate
from esfo_core.events import NS_PER_S

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>
body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; color: #222; }}
table {{ border-collapse: collapse; }}
td, th {{ padding: .2rem 1.2rem .2rem 0; text-align: left; vertical-align: top; }}
.ok {{ color: #197a32; }} .degenerate {{ color: #a15c00; }} .failed {{ color: #b3261e; }} img {{ max-width: 100%; }}
</style></head><body>
<h1>{title}</h1>
<p>Status: <strong class="{status}">{status}</strong> {reason}</p>
<table>{rows}</table>
<p><img alt="Accumulated events with the spin axis" src="{picture}"></p>
{checks}
{alternatives}
<h2>Time</h2><table>{timing}</table>
<p>{versions}</p>
</body></html>
"""


def write_report(result: RunResult, source: Source, versions: Mapping[str, str], folder: Path) -> None:
    """Write `report.html`; reads `axis.png` and, where there is one, `checks.png` from the same folder."""
    estimate = result.estimate
    page = _PAGE.format(
        title=escape(f"Spin of {source.recording.path.name}"),
        status=estimate.status,
        reason=escape(estimate.reason),
        rows=_table(_facts(result, source)),
        picture=_embedded(folder / "axis.png"),
        checks=_checks(folder / "checks.png"),
        alternatives=_alternatives(estimate),
        timing=_table([(name, f"{seconds:.2f} s") for name, seconds in estimate.timing_s.items()]),
        versions=escape(", ".join(f"{name} {version}" for name, version in versions.items())),
    )
    (folder / "report.html").write_text(page)


def _facts(result: RunResult, source: Source) -> list[tuple[str, str]]:
    e, r = result.estimate, source.recording
    facts = [("recording", f"{r.format}, {r.width}x{r.height} px, {(e.t_last - e.t_first) / NS_PER_S:.3f} s")]
    if e.spin is not None:
        axis, center = (", ".join(f"{v:+.4f}" for v in a) for a in (e.spin.axis, e.spin.center))
        facts += [
            ("spin rate", f"{e.spin.rate_hz:.6f} Hz ± {e.rate_std_hz:.6f} ({60 * e.spin.rate_hz:.3f} rpm)"),
            *_slope(e),
            ("axis", f"({axis}) ± {e.axis_std_deg:.3f}°, camera optical frame, right-handed with the spin"),
            ("centre", f"({center}), in {'orbit radii' if e.scale == 'unit' else 'metres'}"),
            ("points", f"{len(e.points)} from {e.tracks} tracks and {e.observations} observations"),
            ("turns seen", f"{e.revolutions:.2f}"),
            ("reprojection error", f"{e.rms_px:.2f} px RMS"),
            ("start", f"{e.initialisation}; {result.note}" if result.note else e.initialisation),
        ]
    if e.flags:
        facts.append(("flags", ", ".join(e.flags)))
    return facts


def _slope(e: OrbitEstimate) -> list[tuple[str, str]]:
    if not math.isfinite(e.rate_slope_hz_s):
        return []
    return [("its change", f"{e.rate_slope_hz_s:+.2e} Hz/s ± {e.rate_slope_std_hz_s:.1e}")]


def _embedded(picture: Path) -> str:
    return f"data:image/png;base64,{base64.b64encode(picture.read_bytes()).decode()}"


def _checks(picture: Path) -> str:
    if not picture.exists():
        return ""
    return (
        f'<h2>Checks</h2><p><img alt="Spin rate over time, fit of the points" src="{_embedded(picture)}"></p>'
        "<p>Left: by the time that each moment of the event stream takes to come round again. No track, point or axis "
        "goes into it. Single turns are less precise than the estimate, but a slope or a wave means that the motion is "
        "not one constant spin. Right: points beyond a pixel or two are no fixed points of the object, or seen badly."
        "</p>"
    )


def _alternatives(estimate: OrbitEstimate) -> str:
    if not estimate.alternatives:
        return ""
    rows = [
        (a.kind, f"{a.rate_hz:.4f} Hz, " + (f"{a.score_ratio:.2f} times worse" if a.score_ratio else ""))
        for a in estimate.alternatives
    ]
    return f"<h2>Other explanations considered</h2><table>{_table(rows)}</table>"


def _table(rows: list[tuple[str, str]]) -> str:
    return "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
