"""Synthetic feature tracks with exact truth, to test the back-end without a front-end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from esfo_core.camera import Camera
from esfo_core.errors import SimulationError
from esfo_core.events import NS_PER_S
from esfo_core.options import option
from esfo_core.orbit import Spin
from esfo_core.tracks import Tracks


@dataclass(frozen=True)
class SyntheticTrackOptions:
    """Features on the surface of a spinning ball, and how they are tracked and lost."""

    points: int = option(60, "number of surface points", 1)
    object_radius: float = option(0.35, "radius of the ball, as a fraction of the distance to the camera", 0.01, 0.9)
    duration_s: float = option(4.0, "length of the recording in s", 0.01)
    window_s: float = option(0.03, "time between observations of one track in s", 1e-4)
    track_s: float = option(0.3, "longest duration of one track in s", 1e-3)
    noise_px: float = option(0.0, "standard deviation of the noise of each coordinate in px", 0.0)
    outliers: float = option(0.0, "share of false tracks, which move on a straight line", 0.0, 1.0)
    seed: int = option(0, "seed of the random numbers", 0)


@dataclass(frozen=True)
class SyntheticTracks:
    """Tracks and the truth behind them.

    points: (P, 3) object points in the coordinates of `Spin`.
    point_of_track: (M,) index into points, -1 for an outlier.
    """

    tracks: Tracks
    spin: Spin
    points: NDArray[np.float64]
    point_of_track: NDArray[np.int64]


def synthetic_tracks(spin: Spin, camera: Camera, options: SyntheticTrackOptions) -> SyntheticTracks:
    """Observe random points of a ball about `spin.center` while they face the camera.

    A point that stays visible longer than `track_s` gets a new track, as with a real tracker: only the back-end can
    find out that the two belong together.

    Raises SimulationError when nothing is seen or a track could not be as long as two rows.
    """
    if options.track_s < options.window_s:
        raise SimulationError(f"tracks of {options.track_s} s are shorter than the {options.window_s} s between rows")
    rng = np.random.default_rng(options.seed)
    normals = rng.normal(size=(options.points, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    points = normals * options.object_radius * np.linalg.norm(spin.center)
    times = spin.t0 + np.arange(0, options.duration_s * NS_PER_S, options.window_s * NS_PER_S).astype(np.int64)
    rows = max(2, round(options.track_s / options.window_s))
    phase = rng.integers(0, rows, options.points)
    uv, seen = _observe(spin, camera, points, normals, times)

    ids: list[NDArray[np.int64]] = []
    point_of_track: list[int] = []
    kept_uv, kept_t = [], []
    for p, part in _stretches(seen, phase, rows):
        outlier = rng.random() < options.outliers
        track = _straight(uv[part, p], rng) if outlier else uv[part, p]
        ids.append(np.full(len(part), len(point_of_track)))
        point_of_track.append(-1 if outlier else p)
        kept_uv.append(track + options.noise_px * rng.normal(size=track.shape))
        kept_t.append(times[part])
    if not ids:
        raise SimulationError(f"none of {options.points} points is seen by the {camera.width}x{camera.height} camera")
    t = np.concatenate(kept_t)
    tracks = Tracks.from_columns(
        np.concatenate(ids), t, np.concatenate(kept_uv), np.full(len(t), max(options.noise_px, 1e-3))
    )
    return SyntheticTracks(tracks, spin, points, np.array(point_of_track))


def _observe(
    spin: Spin,
    camera: Camera,
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    times: NDArray[np.int64],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Project all points at all times: (T, P, 2) pixels; (T, P) whether a point faces the camera inside the image."""
    uv = np.empty((len(times), len(points), 2))
    seen = np.empty((len(times), len(points)), bool)
    limit = np.array([camera.width - 1, camera.height - 1])
    for k, t in enumerate(times):
        X = spin.transform(points, int(t))
        towards = X - spin.center
        facing = np.einsum("ij,ij->i", towards, X) < -0.3 * np.linalg.norm(towards, axis=1) * np.linalg.norm(X, axis=1)
        uv[k] = camera.project(np.where(X[:, 2:] > 0, X, 1.0))
        seen[k] = facing & (X[:, 2] > 0) & ((uv[k] >= 0) & (uv[k] <= limit)).all(axis=1)
    return uv, seen


def _stretches(seen: NDArray[np.bool_], phase: NDArray[np.int64], rows: int) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield the point and the times, as indices, of every track: a stretch of visibility of at most `rows` times."""
    for p in range(seen.shape[1]):
        visible = np.flatnonzero(seen[:, p])
        if not len(visible):
            continue
        starts = (np.diff(visible, prepend=visible[0]) > 1) | ((visible + phase[p]) % rows == 0)
        for part in np.split(visible, np.flatnonzero(starts)):
            if len(part) >= 2:
                yield p, part


def _straight(uv: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """A straight track from the same place, of a similar speed in another direction."""
    step = np.linalg.norm(uv[-1] - uv[0]) / len(uv) + 0.5
    angle = rng.uniform(0, 2 * np.pi)
    return np.asarray(uv[0] + np.arange(len(uv))[:, None] * step * np.array([np.cos(angle), np.sin(angle)]))
