"""The report of a run: one self-contained HTML file."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path

from esfo_bringup.offline.pipeline import RunResult
from esfo_bringup.offline.source import Source
from esfo_core.estimate import OrbitEstimate
from esfo_core.estimate_text import facts
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
    """Write `report.html`, with `axis.png` and, where it exists, `checks.png` from the same folder."""
    estimate = result.estimate
    page = _PAGE.format(
        title=escape(f"Spin of {source.recording.path.name}"),
        status=estimate.status,
        reason=escape(estimate.reason),
        rows=_table(_facts(result, source).items()),
        picture=_embedded(folder / "axis.png"),
        checks=_checks(folder / "checks.png"),
        alternatives=_alternatives(estimate),
        timing=_table([(name, f"{seconds:.2f} s") for name, seconds in estimate.timing_s.items()]),
        versions=escape(", ".join(f"{name} {version}" for name, version in versions.items())),
    )
    (folder / "report.html").write_text(page, encoding="utf-8", errors="backslashreplace")


def _facts(result: RunResult, source: Source) -> dict[str, str]:
    e, r = result.estimate, source.recording
    recording = f"{r.format}, {r.width}x{r.height} px, {(e.t_last - e.t_first) / NS_PER_S:.3f} s"
    found = {name: value.replace("+-", "±") for name, value in facts(e, result.note).items()}
    return {"recording": recording, **found}


def _embedded(picture: Path) -> str:
    return f"data:image/png;base64,{base64.b64encode(picture.read_bytes()).decode()}"


def _checks(picture: Path) -> str:
    if not picture.exists():
        return ""
    return (
        f'<h2>Checks</h2><p><img alt="Spin rate over time, fit of the points" src="{_embedded(picture)}"></p>'
        "<p>Left: spin rate of single turns, from the correlation of the event stream with itself one turn later; no "
        "track, point or axis is used. It is less precise than the estimate, but a slope or an oscillation shows that "
        "the spin rate is not constant. Right: points with an error of more than one or two pixels are not fixed to "
        "the object, or were observed badly.</p>"
    )


def _alternatives(estimate: OrbitEstimate) -> str:
    if not estimate.alternatives:
        return ""
    rows = [
        (a.kind, f"{a.rate_hz:.4f} Hz, " + (f"{a.score_ratio:.2f} times worse" if a.score_ratio else ""))
        for a in estimate.alternatives
    ]
    return f"<h2>Alternative explanations</h2><table>{_table(rows)}</table>"


def _table(rows: Iterable[tuple[str, str]]) -> str:
    return "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
