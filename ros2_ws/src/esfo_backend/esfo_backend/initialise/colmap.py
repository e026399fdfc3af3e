"""COLMAP from feature tracks (paper, section 5.1): every time window is a camera, every track a 3-D point."""

from __future__ import annotations

import ctypes
import signal
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from esfo_backend.errors import BackendError
from esfo_backend.initialise.circle import CameraOrbit, orbit_of_cameras
from esfo_backend.options import InitialisationOptions
from esfo_core.camera import Camera
from esfo_core.events import NS_PER_S
from esfo_core.orbit import Matrix, Vector
from esfo_core.tracks import Tracks

if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
    # Importing pycolmap makes SIGTERM print a stack dump. Python can restore it in its main thread only, C anywhere.
    ctypes.CDLL(None).signal(int(signal.SIGTERM), None)

# Tracks without a model are reported by BackendError; COLMAP's own messages are suppressed.
pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)

_SEED = 1
_MIN_SHARED = 8
_WIDEST_PAIR = 6


@dataclass(frozen=True)
class Views:
    """Observations by view.

    seconds: (V,) mean time of each view from the first row, s. uv: per view (K, 2) ideal pixels. track: per view (K,)
    track ids, ascending.
    """

    seconds: Vector
    uv: list[Matrix]
    track: list[NDArray[np.uint32]]


@dataclass(frozen=True)
class ColmapResult:
    """Orbit of COLMAP's cameras, number of registered and of all views, and RMS reprojection error."""

    orbit: CameraOrbit
    registered: int
    views: int
    rms_px: float


def cut_views(tracks: Tracks, camera: Camera, window_s: float) -> Views:
    """Group observations into windows of `window_s`; of several of a track in one window, the first is kept."""
    ordered = tracks.sorted()
    window = (ordered.t - ordered.t.min()) // round(window_s * NS_PER_S)
    _, unique = np.unique(np.stack([window, ordered.track_id.astype(np.int64)]), axis=1, return_index=True)
    rows = np.sort(unique)
    window, kept = window[rows], ordered.select(rows)
    ideal = camera.unproject(kept.uv) * [camera.K[0, 0], camera.K[1, 1]] + [camera.K[0, 2], camera.K[1, 2]]
    members = [np.flatnonzero(window == w) for w in np.unique(window)]
    seconds = (kept.t - ordered.t.min()) / NS_PER_S
    by_track = [m[np.argsort(kept.track_id[m])] for m in members]
    return Views(
        np.array([seconds[m].mean() for m in by_track]),
        [ideal[m] for m in by_track],
        [kept.track_id[m] for m in by_track],
    )


def bounded(views: Views, options: InitialisationOptions) -> Views:
    """Return the consecutive views with the most tracks, and of each view the tracks that are in the most views.

    Views within the limits of the options are unchanged. COLMAP's time grows with both numbers, its accuracy does not:
    further revolutions add nothing, since its landmarks are not re-identified.
    """
    counts = np.array([len(t) for t in views.track])
    width = min(options.colmap_max_views, len(counts))
    begin = int(np.argmax(np.convolve(np.minimum(counts, options.colmap_max_tracks), np.ones(width), "valid")))
    stretch = slice(begin, begin + width)
    ids, lengths = np.unique(np.concatenate(views.track[stretch]), return_counts=True)
    kept = [
        np.sort(np.argsort(-lengths[np.searchsorted(ids, t)], kind="stable")[: options.colmap_max_tracks])
        for t in views.track[stretch]
    ]
    return Views(
        views.seconds[stretch],
        [uv[k] for uv, k in zip(views.uv[stretch], kept, strict=True)],
        [t[k] for t, k in zip(views.track[stretch], kept, strict=True)],
    )


def run_colmap(tracks: Tracks, camera: Camera, options: InitialisationOptions) -> ColmapResult:
    """Run COLMAP with fixed intrinsics and seeds on one thread: the result is deterministic.

    Raises BackendError when the tracks are too sparse, when there is no model, or when its cameras are no orbit.
    """
    views = bounded(cut_views(tracks, camera, options.colmap_window_s), options)
    density = float(np.mean([len(t) for t in views.track]))
    if density < options.colmap_min_tracks:
        raise BackendError(f"{density:.1f} tracks per view are too few for COLMAP ({options.colmap_min_tracks:g})")
    with tempfile.TemporaryDirectory(prefix="esfo_colmap_") as folder:
        database = Path(folder) / "database.db"
        _write_database(database, views, camera)
        models = pycolmap.incremental_mapping(str(database), folder, folder, _mapping_options())
    if not models:
        raise BackendError(f"COLMAP found no model in {len(views.seconds)} views of {density:.1f} tracks")
    model = max(models.values(), key=lambda m: m.num_reg_images())
    images = [i for i in model.images.values() if i.has_pose]
    R = np.array([i.cam_from_world().rotation.matrix() for i in images])
    t = np.array([i.cam_from_world().translation for i in images])
    orbit = orbit_of_cameras(R, t, views.seconds[[int(i.name) for i in images]])
    return ColmapResult(orbit, len(images), len(views.seconds), float(model.compute_mean_reprojection_error()))


def _write_database(path: Path, views: Views, camera: Camera) -> None:
    """Write keypoints and verified pairs. Pairs are up to 5 views apart; RANSAC removes gross outliers."""
    pycolmap.set_random_seed(_SEED)
    intrinsics = [camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]]
    model = pycolmap.Camera(model="PINHOLE", width=camera.width, height=camera.height, params=intrinsics, camera_id=1)
    model.has_prior_focal_length = True
    two_view = pycolmap.TwoViewGeometryOptions()
    two_view.min_num_inliers = _MIN_SHARED
    two_view.ransac.random_seed = _SEED
    two_view.ransac.max_error = 3.0
    two_view.ransac.min_num_trials = 30  # most tracks are inliers; otherwise RANSAC continues by itself
    two_view.detect_watermark = False
    with pycolmap.Database.open(str(path)) as database:
        database.write_camera(model, use_camera_id=True)
        rig = pycolmap.Rig(rig_id=1)
        rig.add_ref_sensor(model.sensor_id)
        database.write_rig(rig, use_rig_id=True)
        for k, uv in enumerate(views.uv):
            image = pycolmap.Image(name=str(k), camera_id=1, image_id=k + 1)
            database.write_image(image, use_image_id=True)
            frame = pycolmap.Frame(frame_id=k + 1, rig_id=1)
            frame.add_data_id(image.data_id)
            database.write_frame(frame, use_frame_id=True)
            # In COLMAP the centre of the first pixel is (0.5, 0.5), here (0, 0).
            database.write_keypoints(k + 1, np.ascontiguousarray(uv + 0.5, np.float32))
        for a, b, matches in _pairs(views):
            geometry = pycolmap.estimate_calibrated_two_view_geometry(
                model, views.uv[a] + 0.5, model, views.uv[b] + 0.5, matches, two_view
            )
            database.write_matches(a + 1, b + 1, matches)
            database.write_two_view_geometry(a + 1, b + 1, geometry)


def _pairs(views: Views) -> list[tuple[int, int, NDArray[np.uint32]]]:
    """Pairs of views with the indices of their common tracks."""
    found = []
    for a in range(len(views.track)):
        for b in range(a + 1, min(a + 1 + _WIDEST_PAIR, len(views.track))):
            _, in_a, in_b = np.intersect1d(views.track[a], views.track[b], assume_unique=True, return_indices=True)
            if len(in_a) >= _MIN_SHARED:
                found.append((a, b, np.ascontiguousarray(np.stack([in_a, in_b], axis=1), np.uint32)))
    return found


def _mapping_options() -> pycolmap.IncrementalPipelineOptions:
    """Fixed intrinsics, one thread, fixed seeds, and limits that fit tens of points per view instead of thousands."""
    o = pycolmap.IncrementalPipelineOptions()
    o.num_threads = 1
    o.random_seed = _SEED
    o.mapper.num_threads = 1
    o.mapper.random_seed = _SEED
    o.triangulation.random_seed = _SEED
    o.multiple_models = False
    o.extract_colors = False
    o.ba_global_frames_ratio = o.ba_global_points_ratio = 1.4  # the factor graph refines the result
    o.ba_global_max_refinements = 2
    o.ba_refine_focal_length = False
    o.ba_refine_principal_point = False
    o.ba_refine_extra_params = False
    o.mapper.abs_pose_refine_focal_length = False
    o.mapper.abs_pose_refine_extra_params = False
    o.min_num_matches = _MIN_SHARED
    o.min_model_size = 10
    o.mapper.init_min_num_inliers = _MIN_SHARED
    o.mapper.init_min_tri_angle = 8.0
    o.mapper.abs_pose_min_num_inliers = 6
    return o
