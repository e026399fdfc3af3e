"""The saved state of a back-end: everything that it received, and what incremental estimates start from.

A NumPy archive without pickled objects, read and written here alone; `version` tells its form. Options are not part of
it.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution
from esfo_backend.errors import StateError
from esfo_backend.initialise.initialisation import Initialisation, Method
from esfo_backend.online.incremental import IncrementalSolver
from esfo_backend.online.rate_lock import RateLock
from esfo_backend.online.stream_memory import StreamMemory
from esfo_backend.options import BackendOptions, MemoryOptions
from esfo_backend.orbit.parametrization import Motion
from esfo_backend.spin_rate.correlation import Harmonic, SpinRate
from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.errors import EsfoError
from esfo_core.orbit import Matrix
from esfo_core.tracks import Tracks, TrackUpdate

VERSION = 4

Arrays = dict[str, NDArray[np.generic]]
_COLUMNS = ("track_id", "t", "uv", "sigma")


@dataclass(frozen=True)
class IncrementalState:
    """What incremental estimates start from. new_rows: not in the solver yet. solved_until: end of the last one, ns."""

    rate_lock: RateLock
    incremental: IncrementalSolver
    new_rows: Tracks
    solved_until: int


def save_state(path: Path, camera: Camera, memory: StreamMemory, state: IncrementalState | None) -> None:
    """Write camera, memory and the state of incremental estimates, if there are any.

    Raises StateError when the file cannot be written, ActivityError as `StreamMemory.snapshot`.
    """
    arrays: dict[str, ArrayLike] = {
        "version": VERSION,
        "size": [camera.width, camera.height],
        "K": camera.K,
        "D": camera.D,
        "focal_std": camera.focal_std,
        "distortion_model": camera.distortion_model,
        "reobserved": memory.reobserved,
        "factor": memory.factor,
        "after_gap": memory.after_gap,
        "rate_hz": np.nan if memory.rate_hz is None else memory.rate_hz,
        "begin": [] if memory.begin is None else [memory.begin],
        **_tracks_arrays("", memory.tracks()),
        **_activity_arrays("coarse", memory.coarse),
        **_activity_arrays("recent", memory.recent()),
    }
    if state is not None:
        arrays |= _rate_lock_arrays(state.rate_lock) | _incremental_arrays(state)
    try:
        with path.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)
    except OSError as error:
        raise StateError(f"{path}: {error.strerror}") from error


def load_state(path: Path, options: BackendOptions) -> tuple[Camera, StreamMemory, IncrementalState | None]:
    """Read what `save_state` wrote. Raises StateError for a file that is missing, damaged or of another version."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except OSError as error:
        raise StateError(f"{path}: {error.strerror or error}") from error
    except (ValueError, zipfile.BadZipFile, EOFError, AttributeError) as error:
        raise StateError(f"{path}: not the state of a back-end ({error})") from error
    version = arrays.get("version")
    if version is None or version != VERSION:
        raise StateError(f"{path}: state of version {version}, this is version {VERSION}")
    try:
        camera = _camera(arrays)
        return camera, _memory(arrays, options.memory), _incremental(arrays, camera, options)
    except (KeyError, ValueError, IndexError, TypeError, EsfoError) as error:
        raise StateError(f"{path}: damaged state ({error})") from error


def _camera(arrays: Arrays) -> Camera:
    width, height = (int(v) for v in arrays["size"])
    K, D = np.asarray(arrays["K"], np.float64), np.asarray(arrays["D"], np.float64)
    return Camera(
        width, height, K, str(arrays["distortion_model"]), D, float(np.asarray(arrays["focal_std"], np.float64))
    )


def _memory(arrays: Arrays, options: MemoryOptions) -> StreamMemory:
    memory = StreamMemory(options)
    begin = int(arrays["begin"][0]) if len(arrays["begin"]) else None
    memory.restore(begin, bool(arrays["after_gap"]), _activity("coarse", arrays), int(arrays["factor"]))
    rate_hz = float(arrays["rate_hz"])
    memory.rate_hz = None if np.isnan(rate_hz) else rate_hz
    memory.reobserved = np.asarray(arrays["reobserved"], np.uint32)
    memory.add(TrackUpdate(_tracks("", arrays), np.empty(0, np.uint32)), _activity("recent", arrays))
    return memory


def _incremental_arrays(state: IncrementalState) -> dict[str, ArrayLike]:
    solver = state.incremental
    if solver.motion is None:
        return {}
    return {
        "solved_until": state.solved_until,
        "working_Q": solver.motion.Q,
        "working_rate_hz": solver.motion.rate_hz,
        "working_focal": [solver.camera.focal_px, solver.camera.focal_std],
        "working_ids": solver.ids,
        "working_label": solver.label,
        "working_lost": solver.lost,
        **_tracks_arrays("working_", Tracks.concatenate([solver.tracks, state.new_rows])),
    }


def _incremental(arrays: Arrays, camera: Camera, options: BackendOptions) -> IncrementalState | None:
    if "solved_until" not in arrays:
        return None
    solver = IncrementalSolver(camera.with_focal(*np.asarray(arrays["working_focal"], np.float64).tolist()), options)
    Q = np.asarray(arrays["working_Q"], np.float64).reshape(3, 3)
    solver.motion = Motion(Q, float(np.asarray(arrays["working_rate_hz"], np.float64)))
    solver.ids = np.asarray(arrays["working_ids"], np.uint32)
    solver.label = np.asarray(arrays["working_label"], np.int64)
    solver.lost = np.asarray(arrays["working_lost"], np.uint32)
    solver.tracks = _tracks("working_", arrays)
    return IncrementalState(_rate_lock(arrays), solver, Tracks.empty(), int(arrays["solved_until"]))


def _rate_lock_arrays(lock: RateLock) -> dict[str, ArrayLike]:
    """Everything but the landmarks of the initialisation, which nothing needs any more."""
    second = [] if lock.initialisation.second is None else [lock.initialisation.second]
    optima = (lock.initialisation.solution, *second)
    harmonics = [[h.rate_hz, h.correlation, h.z] for h in lock.rate.harmonics]
    return {
        "lock_rate": [lock.rate.rate_hz, lock.rate.correlation, lock.rate.prominence],
        "lock_harmonics": np.reshape(harmonics, (-1, 3)),
        "lock_optima": [[*s.motion.Q.ravel(), s.motion.rate_hz, s.cost] for s in optima],
        "lock_initialisation": [lock.initialisation.name, lock.initialisation.colmap_note],
        "lock_revolutions": lock.revolutions,
        "lock_certain": lock.certain,
    }


def _rate_lock(arrays: Arrays) -> RateLock:
    rate, correlation, prominence = (float(v) for v in np.asarray(arrays["lock_rate"], np.float64))
    harmonics = [Harmonic(*row) for row in np.asarray(arrays["lock_harmonics"], np.float64).tolist()]
    best, *second = [_optimum(row) for row in np.asarray(arrays["lock_optima"], np.float64)]
    name, note = (str(v) for v in arrays["lock_initialisation"])
    method: Method = "colmap" if name == "colmap" else "direct"
    return RateLock(
        SpinRate(rate, correlation, prominence, tuple(harmonics)),
        Initialisation(best, method, second[0] if second else None, note),
        float(np.asarray(arrays["lock_revolutions"], np.float64)),
        bool(arrays["lock_certain"]),
    )


def _optimum(row: Matrix) -> OrbitSolution:
    return OrbitSolution(Motion(row[:9].reshape(3, 3), float(row[9])), np.empty((0, 3)), float(row[10]), 0)


def _tracks_arrays(prefix: str, tracks: Tracks) -> dict[str, ArrayLike]:
    return {prefix + name: getattr(tracks, name) for name in _COLUMNS}


def _tracks(prefix: str, arrays: Arrays) -> Tracks:
    return Tracks.from_columns(*(arrays[prefix + name] for name in _COLUMNS))


def _activity_arrays(name: str, activity: Activity | None) -> dict[str, ArrayLike]:
    if activity is None:
        return {}
    grid = [activity.t0, activity.bin, activity.cell]
    return {f"{name}_counts": activity.counts, f"{name}_valid": activity.valid, f"{name}_grid": grid}


def _activity(name: str, arrays: Arrays) -> Activity | None:
    if f"{name}_counts" not in arrays:
        return None
    t0, length, cell = (int(v) for v in arrays[f"{name}_grid"])
    counts, valid = arrays[f"{name}_counts"], arrays[f"{name}_valid"]
    return Activity(t0, length, cell, np.asarray(counts, np.uint16), np.asarray(valid, np.bool_))
