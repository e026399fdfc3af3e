"""Where the error of the axis comes from: tracks, then perfect association, then true places, one replaced at a time.

`tracks`: default front-end and back-end, started at the truth, so that no search has a part in it. `associated`: corner
events within 2.5 px of the true path of a corner of the surface that is alone within 4 px, averaged over 4 px of
motion, one track for each corner and polarity; as they come, moved ahead by `association.lag`, or by the median that
each polarity trails. `true`: these rows moved to the true path, which shows that nothing else is wrong. Behind each
error stands the deviation of both of its coordinates together that independent points would have (sandwich estimator,
no common bias).

Corners that are alone are few, so `associated` has fewer points and a larger deviation. Reading: the part of the error
that `associated` lacks comes from following corners, the part that it has from where the detector sees them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from backend import NAMES, folder_of
from numpy.typing import NDArray
from provenance import print_provenance
from scipy.spatial import cKDTree

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution, bundle_adjustment, linear_points
from esfo_backend.adjustment.covariance import motion_covariance, schur_marginal
from esfo_backend.initialise.initialisation import Initialisation
from esfo_backend.landmarks.landmarks import build_landmarks, prune
from esfo_backend.options import BackendOptions
from esfo_backend.orbit.observations import Observations, observations
from esfo_backend.orbit.parametrization import motion_from_axis
from esfo_bringup.benchmark.orbit_accuracy import track
from esfo_core.events import EventArray
from esfo_core.recordings import open_recording
from esfo_core.tracks import Tracks
from esfo_frontend.corners.detector import CornerDetector
from esfo_frontend.options import PRESETS
from esfo_simulation.landmarks import corner_vertices, visible
from esfo_simulation.scene import Scene, SceneOptions, simulate
from esfo_simulation.scene_files import is_written, topspin, write_scene

SUBSET = tuple(n for n in NAMES if n.endswith("-med"))
STEP_NS = 4_000_000
NEAR_PX, ALONE_PX, ROW_PX = 2.5, 4.0, 4.0
MIN_CORNERS, MIN_ROWS = 3, 6
SIGMA_PX = 0.35
OPTIONS = BackendOptions()

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class ObservationRows:
    """Averaged corner events.

    track: (N,) 2 x corner + polarity. t: (N,) ns. uv: (N, 2) px. offset: (N, 2) px from the true path. way: (N, 2) unit
    vector, direction of that path.
    """

    track: NDArray[np.int64]
    t: Vector
    uv: Vector
    offset: Vector
    way: Vector

    @property
    def trails(self) -> Vector:
        """How far rows lie behind the true path along the motion, (N,) px."""
        return -np.asarray((self.offset * self.way).sum(axis=1))


def corner_events(path: Path, scene: Scene) -> EventArray:
    """Return all eFAST corners of a recording."""
    detector = CornerDetector(scene.camera.width, scene.camera.height, PRESETS["default"].corners)
    return np.concatenate([events[detector.detect(events)] for events in open_recording(path).chunks()])


def near_true_paths(events: EventArray, scene: Scene) -> Iterator[Vector]:
    """Give for each stretch of time the events of corners that are alone.

    Columns (M, 9): track, t, x, y, offset from the true path at t (2), velocity of the path, px/s (2), its speed.
    """
    model, camera = scene.simulation.model, scene.camera
    points = corner_vertices(model)
    for begin in np.arange(events["t"][0], events["t"][-1], STEP_NS):
        first, last = np.searchsorted(events["t"], [begin, begin + STEP_NS])
        part, middle = events[first:last], float(begin + STEP_NS / 2)
        at, seen = visible(model, points, camera, scene.motion.pose(middle))
        later, _ = visible(model, points, camera, scene.motion.pose(middle + STEP_NS))
        k = np.flatnonzero(seen)
        if len(k) < 2 or not len(part):
            continue
        velocity = (later[k] - at[k]) / (STEP_NS * 1e-9)
        tree = cKDTree(at[k])
        alone = tree.query(at[k], 2)[0][:, 1] > ALONE_PX
        xy = np.stack([part["x"], part["y"]], axis=1).astype(float)
        j = tree.query(xy)[1]
        offset = xy - at[k][j] - velocity[j] * ((part["t"] - middle) * 1e-9)[:, None]
        own = alone[j] & (np.hypot(*offset.T) < NEAR_PX)
        speed = np.hypot(*velocity[j].T)
        columns = (2 * k[j] + part["p"], part["t"], *xy.T, *offset.T, *velocity[j].T, speed)
        yield np.stack(columns, axis=1)[own]


def associated_rows(events: EventArray, scene: Scene) -> ObservationRows:
    """Average the events of each corner and polarity over `ROW_PX` of motion."""
    e = np.concatenate(list(near_true_paths(events, scene)))
    e = e[np.lexsort((e[:, 1], e[:, 0]))]
    same = e[1:, 0] == e[:-1, 0]
    moved = np.concatenate([[0.0], np.where(same, np.diff(e[:, 1]) * 1e-9 * e[1:, 8], 0.0)])
    path = np.cumsum(moved)
    start = np.flatnonzero(np.concatenate([[True], ~same]))
    track = np.cumsum(np.concatenate([[True], ~same])) - 1
    _, row, count = np.unique(
        np.stack([track, (path - path[start][track]) // ROW_PX]), axis=1, return_inverse=True, return_counts=True
    )
    row = row.ravel()
    mean = np.stack([np.bincount(row, column) / count for column in e.T], axis=1)[count >= MIN_CORNERS]
    way = mean[:, 6:8] / np.hypot(*mean[:, 6:8].T)[:, None]
    return ObservationRows(np.rint(mean[:, 0]).astype(np.int64), mean[:, 1], mean[:, 2:4], mean[:, 4:6], way)


def judged(solution: OrbitSolution, obs: Observations, scene: Scene) -> str:
    """Error of the axis and its deviation for independent points, degrees, and the number of points."""
    cauchy_px = OPTIONS.graph.cauchy_px
    off = np.degrees(np.arccos(min(abs(float(solution.motion.axis @ scene.spin.axis)), 1.0)))
    covariance = motion_covariance(solution, obs, schur_marginal(solution, obs, cauchy_px), cauchy_px)
    std = np.degrees(np.sqrt(np.trace(covariance.axis_cov)))
    return f"{off:.3f} ({std:.3f}), {obs.points}"


def of_tracks(tracks: Tracks, scene: Scene) -> str:
    """Solve as the back-end does, from the truth."""
    obs, _ = observations(tracks, scene.camera, OPTIONS.initialisation.min_observations)
    motion = motion_from_axis(scene.spin.axis, scene.spin.center, scene.spin.rate_hz)
    begun = bundle_adjustment(motion, linear_points(motion, obs), obs, OPTIONS.initialisation.cauchy_px, False)
    found = prune(build_landmarks(Initialisation(begun, "direct", None, "the truth"), obs, OPTIONS), OPTIONS)
    return judged(found.solution, found.obs, scene)


def of_rows(rows: ObservationRows, uv: Vector, scene: Scene) -> str:
    """Solve with the corner of each row known, which is at uv (N, 2)."""
    tracks = Tracks.from_columns(rows.track, np.rint(rows.t).astype(np.int64), uv, np.full(len(uv), SIGMA_PX))
    obs, _ = observations(tracks, scene.camera, MIN_ROWS)
    motion = motion_from_axis(scene.spin.axis, scene.spin.center, scene.spin.rate_hz)
    return judged(bundle_adjustment(motion, linear_points(motion, obs), obs, OPTIONS.graph.cauchy_px), obs, scene)


def run_scene(name: str, options: SceneOptions, folder: Path) -> None:
    """Print the row of one scene."""
    path = folder / f"{name}.mcap"
    if not is_written(options, path):
        write_scene(options, path)
    scene = simulate(options)
    rows = associated_rows(corner_events(path, scene), scene)
    polarity = rows.track % 2
    trails = np.array([np.median(rows.trails[polarity == p]) for p in (0, 1)])
    lag = PRESETS["default"].association.lag
    cells = (
        name,
        of_tracks(track(open_recording(path).chunks(), scene.camera).tracks, scene),
        of_rows(rows, rows.uv, scene),
        of_rows(rows, rows.uv + lag * rows.way, scene),
        of_rows(rows, rows.uv + trails[polarity][:, None] * rows.way, scene),
        of_rows(rows, rows.uv - rows.offset, scene),
        f"{trails[0]:+.2f}, {trails[1]:+.2f}",
    )
    print(f"| {' | '.join(cells)} |", flush=True)


def main() -> None:
    """Run the scenes asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", action="append", choices=NAMES, help="only this one; may be repeated")
    parser.add_argument("--folder", type=Path, help="keep the scenes here, and take those that are there")
    args = parser.parse_args()
    print_provenance()
    scenes = topspin(SceneOptions(width=346, height=260, revolutions=2.5))
    print("axis, deg (deviation), points; trails: distance of the detected behind the true corners, px\n")
    print("| scene | tracks | associated | moved by lag | moved by polarity | true | trails: OFF, ON |")
    print("|---|---|---|---|---|---|---|")
    with folder_of(args.folder) as folder:
        for name in args.scene or SUBSET:
            run_scene(name, scenes[name], folder)


if __name__ == "__main__":
    main()
