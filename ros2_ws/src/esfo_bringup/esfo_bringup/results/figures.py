"""The pictures of a run: events with the axis drawn in, the structure about the axis, the spin rate over time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from esfo_bringup.results.event_image import LONGEST_MOMENT_NS, EventImage
from esfo_bringup.results.rate_over_time import RateOverTime
from esfo_core.camera import Camera
from esfo_core.estimate import OrbitEstimate
from esfo_core.events import NS_PER_S
from esfo_core.orbit import object_frame

_SNAPSHOT_TURN = 0.02
_LEAST_RATE_RANGE = 0.002
_AXIS_COLOUR = "#d62728"
_POINT_COLOUR = "#2ca02c"


def draw_events(estimate: OrbitEstimate, camera: Camera, event_image: EventImage) -> Figure:
    """Draw the events of a moment with the projected points, all events with the axis, and the structure."""
    spin = estimate.spin
    duration = LONGEST_MOMENT_NS
    if spin is not None:
        duration = min(duration, round(_SNAPSHOT_TURN / spin.rate_hz * NS_PER_S))
    moment = event_image.moment(duration)
    widths = [1.0, 1.0] if spin is None else [1.0, 1.0, 0.6]
    figure = Figure(figsize=(5.4 * sum(widths), 4.6), layout="constrained")
    axes = figure.subplots(1, len(widths), width_ratios=widths)
    _image(axes[0], event_image.count(moment), f"events of {duration / 1e6:.0f} ms")
    _image(axes[1], event_image.counts, "all events")
    if spin is not None:
        half = 1.2 * float(np.linalg.norm(estimate.points, axis=1).max(initial=0.1))
        for panel in axes[:2]:
            line = spin.screw_line(camera, half)
            panel.plot(line[:, 0], line[:, 1], color=_AXIS_COLOUR, lw=2, label=f"axis, {spin.rate_hz:.4f} Hz")
        if len(moment):
            _points(axes[0], estimate, camera, (int(moment["t"][0]) + int(moment["t"][-1])) // 2)
        axes[1].legend(loc="lower right")
        _structure(axes[2], estimate)
    for panel in axes[:2]:
        panel.set_xlim(-0.5, camera.width - 0.5)
        panel.set_ylim(camera.height - 0.5, -0.5)
    return figure


def draw_checks(estimate: OrbitEstimate, rates: RateOverTime) -> Figure:
    """Draw the rate over time beside the estimate, and how well the points fit. The estimate has a motion."""
    spin = estimate.spin
    assert spin is not None
    figure = Figure(figsize=(14.0, 3.4), layout="constrained")
    rate, fit = figure.subplots(1, 2, width_ratios=[2.0, 1.0])
    duration = (estimate.t_last - estimate.t_first) / NS_PER_S
    rate.plot(rates.t_s, rates.rate_hz, "o-", ms=4, lw=1, label="of the event stream, turn by turn")
    t = np.array([0.0, duration])
    line = np.full(2, spin.rate_hz)
    if "rate_not_constant" in estimate.flags and np.isfinite(estimate.rate_slope_hz_s):
        line += estimate.rate_slope_hz_s * (t - (spin.t0 - estimate.t_first) / NS_PER_S)
    rate.plot(t, line, color=_AXIS_COLOUR, label="estimate ± 3 standard deviations")
    if np.isfinite(estimate.rate_std_hz):
        rate.fill_between(
            t, line - 3 * estimate.rate_std_hz, line + 3 * estimate.rate_std_hz, color=_AXIS_COLOUR, alpha=0.2
        )
    shown = np.concatenate([rates.rate_hz, line])
    least = _LEAST_RATE_RANGE * spin.rate_hz  # so that noise does not fill the panel
    rate.set_ylim(min(shown.min(), line.min() - least), max(shown.max(), line.max() + least))
    rate.set_xlim(0.0, duration)
    rate.ticklabel_format(axis="y", useOffset=False)
    rate.set(title="spin rate over time", xlabel="time (s), middle of the turn", ylabel="Hz")
    rate.legend()
    fit.hist(estimate.point_rms_px, bins=40, color=_POINT_COLOUR)
    fit.set(title="fit of the points", xlabel="reprojection error, RMS over a point's rows (px)", ylabel="points")
    return figure


def _image(panel: Axes, counts: NDArray[np.uint32], title: str) -> None:
    """Draw off events blue and on events red, on white; the brightest percent saturates."""
    strength = np.log1p(counts)
    positive = strength[strength > 0]
    strength /= np.percentile(positive, 99) if len(positive) else 1.0
    off, on = np.clip(strength, 0, 1)
    panel.imshow(1 - np.stack([off, np.maximum(off, on), on], axis=-1) * 0.8, interpolation="nearest")
    panel.set_title(title)
    panel.set_xticks([])
    panel.set_yticks([])


def _points(panel: Axes, estimate: OrbitEstimate, camera: Camera, t: int) -> None:
    assert estimate.spin is not None
    X = estimate.spin.transform(estimate.points, t)
    uv = camera.project(X[X[:, 2] > 0])
    panel.plot(uv[:, 0], uv[:, 1], ".", color=_POINT_COLOUR, ms=4, label="points, front and back")
    panel.legend(loc="lower right")


def _structure(panel: Axes, estimate: OrbitEstimate) -> None:
    """Draw the points by distance from the axis and height along it: a rotating object shows its profile."""
    assert estimate.spin is not None
    X = estimate.points @ object_frame(estimate.spin.axis)
    panel.scatter(np.hypot(X[:, 0], X[:, 1]), X[:, 2], s=8, c=estimate.point_observations, cmap="viridis")
    panel.axvline(0, color=_AXIS_COLOUR, lw=2)
    panel.set_aspect("equal", adjustable="box")
    panel.set_title(f"{len(estimate.points)} points, the light ones seen often")
    panel.set_xlabel("distance from the axis (orbit radii)")
    panel.set_ylabel("along the axis")
