"""Metric scale: events do not determine it; one known length does."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import pdist

from esfo_backend.errors import BackendError
from esfo_backend.options import ScaleOptions
from esfo_core.errors import OptionError
from esfo_core.estimate import OrbitEstimate
from esfo_core.orbit import Matrix, Spin


def check_scale(options: ScaleOptions) -> None:
    """Raise OptionError when more than one length is given, since they may contradict each other."""
    given = {name: value for name, value in vars(options).items() if value}
    if len(given) > 1:
        raise OptionError(f"more than one known length: {', '.join(f'scale.{k} = {v}' for k, v in given.items())}")


def metric(estimate: OrbitEstimate, options: ScaleOptions) -> OrbitEstimate:
    """Return the estimate in metres when a length is known, otherwise unchanged.

    Raises BackendError when the estimate gives that length as zero.
    """
    spin = estimate.spin
    if spin is None or not any(vars(options).values()):
        return estimate
    if options.distance_m:
        known, found = options.distance_m, float(np.linalg.norm(spin.center))
    elif options.radius_m:
        off_axis = spin.center - (spin.center @ spin.axis) * spin.axis
        known, found = options.radius_m, float(np.linalg.norm(off_axis))
    else:
        known, found = options.size_m, diameter(estimate.points)
    if not found > 0:
        raise BackendError(f"a known length of {known} m does not give the scale: the estimate has {found} for it")
    factor = known / found
    return replace(
        estimate,
        spin=Spin(spin.axis, spin.rate_hz, factor * spin.center, spin.t0),
        points=factor * estimate.points,
        scale="metric",
        flags=tuple(flag for flag in estimate.flags if flag != "scale_unobservable"),
    )


def diameter(points: Matrix) -> float:
    """Largest distance between two of the points (P, 3); 0 for fewer than two."""
    if len(points) < 2:
        return 0.0
    with suppress(QhullError):  # fewer than four points, or all in one plane: compare all of them
        points = points[ConvexHull(points).vertices]
    return float(pdist(points).max())
