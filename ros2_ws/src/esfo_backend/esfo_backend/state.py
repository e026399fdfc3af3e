"""What a back-end has received, as a file, so that it can go on where it stopped.

A NumPy archive without pickled objects; `version` tells its form. Options are not part of it.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from esfo_backend.errors import StateError
from esfo_backend.online.incremental import IncrementalSolver
from esfo_backend.online.rate_lock import RateLock
from esfo_backend.online.stream_memory import StreamMemory
from esfo_backend.options import BackendOptions, MemoryOptions
from esfo_core.activity import Activity
from esfo_core.camera import Camera
from esfo_core.errors import EsfoError
from esfo_core.tracks import Tracks, TrackUpdate

VERSION = 2

Arrays = dict[str, NDArray[np.generic]]


@dataclass(frozen=True)
class IncrementalState:
    """What live estimates go on from: the incremental with rows that wait for it, ns of the last estimate."""

    rate_lock: RateLock
    incremental: IncrementalSolver
    news: Tracks
    solved_until: int


def save_state(path: Path, camera: Camera, history: StreamMemory, following: IncrementalState | None) -> None:
    """Write camera, history and what is followed, if anything is.

    Raises StateError when the file cannot be written, ActivityError as `StreamMemory.seen`.
    """
    tracks = history.tracks()
    arrays: dict[str, ArrayLike] = {
        "version": VERSION,
        "size": [camera.width, camera.height],
        "K": camera.K,
        "D": camera.D,
        "distortion_model": camera.distortion_model,
        "track_id": tracks.track_id,
        "t": tracks.t,
        "uv": tracks.uv,
        "sigma": tracks.sigma,
        "recurring": history.recurring,
        "factor": history.factor,
        "after_gap": history.after_gap,
        "rate_hz": np.nan if history.rate_hz is None else history.rate_hz,
        "begin": [] if history.begin is None else [history.begin],
        **_of_activity("coarse", history.coarse),
        **_of_activity("recent", history.recent()),
        **_of_following(following),
    }
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
        return camera, _memory(arrays, options.memory), _following(arrays, camera, options)
    except (KeyError, ValueError, IndexError, TypeError, EsfoError) as error:
        raise StateError(f"{path}: damaged state ({error})") from error


def _camera(arrays: Arrays) -> Camera:
    width, height = (int(v) for v in arrays["size"])
    K, D = np.asarray(arrays["K"], np.float64), np.asarray(arrays["D"], np.float64)
    return Camera(width, height, K, str(arrays["distortion_model"]), D)


def _memory(arrays: Arrays, options: MemoryOptions) -> StreamMemory:
    history = StreamMemory(options)
    begin = int(arrays["begin"][0]) if len(arrays["begin"]) else None
    history.restore(begin, bool(arrays["after_gap"]), _activity("coarse", arrays), int(arrays["factor"]))
    rate_hz = float(arrays["rate_hz"])
    history.rate_hz = None if np.isnan(rate_hz) else rate_hz
    history.recurring = np.asarray(arrays["recurring"], np.uint32)
    tracks = Tracks.from_columns(*(arrays[name] for name in ("track_id", "t", "uv", "sigma")))
    history.add(TrackUpdate(tracks, np.empty(0, np.uint32)), _activity("recent", arrays))
    return history


def _of_following(following: IncrementalState | None) -> dict[str, ArrayLike]:
    if following is None:
        return {}
    followed = following.incremental.arrays(following.news)
    return {**following.rate_lock.arrays(), **followed, "solved_until": following.solved_until}


def _following(arrays: Arrays, camera: Camera, options: BackendOptions) -> IncrementalState | None:
    if "solved_until" not in arrays:
        return None
    incremental = IncrementalSolver(camera, options)
    incremental.restore(arrays)
    return IncrementalState(RateLock.from_arrays(arrays), incremental, Tracks.empty(), int(arrays["solved_until"]))


def _of_activity(name: str, activity: Activity | None) -> dict[str, ArrayLike]:
    if activity is None:
        return {}
    return {f"{name}_counts": activity.counts, f"{name}_grid": [activity.t0, activity.bin, activity.cell]}


def _activity(name: str, arrays: Arrays) -> Activity | None:
    if f"{name}_counts" not in arrays:
        return None
    t0, length, cell = (int(v) for v in arrays[f"{name}_grid"])
    return Activity(t0, length, cell, np.asarray(arrays[f"{name}_counts"], np.uint16))
