"""How long and how true the tracks are, paper preset against default: prints the tables of docs/benchmarks.md.

Every track of at least 4 rows is set against the one fixed point that fits it best under the true motion. It is good
when every row lies within 3 px of that point. Ages are those of good tracks, from first to last row; `oldest`: the mean
of as many of the oldest as the paper preset has in all, since a preset that cannot give short tracks looks old else.
`pull`: offsets of good tracks over their stated sigma, RMS. Delay: from the mean time of a row until it comes out,
median and maximum. `off true corners`: how far from the nearest true corner rows lie, along and across the motion.

The second part is the protocol of the paper's front-end evaluation: a track counts where its RMSE is within the
threshold.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from provenance import print_provenance
from tracking_truth import offset_to_corners, places, poses_of

from esfo_core.camera import Camera
from esfo_core.evaluation.track_error import FittedTracks, fit_tracks
from esfo_core.events import NS_PER_S, EventArray
from esfo_core.options import parse_assignments, replace
from esfo_core.tracks import Tracks
from esfo_frontend.frontend import Frontend
from esfo_frontend.options import PRESETS, FrontendOptions
from esfo_frontend.warm_up import warm_up
from esfo_simulation.handheld.rooms import corners
from esfo_simulation.handheld.scene import HandheldOptions, handheld_scene
from esfo_simulation.landmarks import corner_vertices, visible
from esfo_simulation.scene import Scene, SceneOptions, simulate
from esfo_simulation.sensor.options import SensorOptions

SMALL = {"width": 346, "height": 260}
SCENES = {
    "hubble, sideon, 0.2 Hz": SceneOptions(object="hubble", view="sideon", rate_hz=0.2, revolutions=0.5, **SMALL),
    "hubble, diagonal, 1 Hz, 480x360": SceneOptions(object="hubble", view="diagonal", rate_hz=1.0, revolutions=1.0),
    "soho, diagonal, 0.5 Hz": SceneOptions(object="soho", rate_hz=0.5, revolutions=1.0, seed=2, **SMALL),
    "soho, topdown, 3.3 Hz": SceneOptions(object="soho", view="topdown", rate_hz=3.3, revolutions=2.0, seed=3, **SMALL),
    "tdrs, perpendicular, 0.5 Hz": SceneOptions(
        object="tdrs", view="perpendicular", rate_hz=0.5, revolutions=1.0, seed=4, **SMALL
    ),
    "dualshock, sideon, 2 Hz": SceneOptions(
        object="dualshock", view="sideon", rate_hz=2.0, revolutions=1.5, seed=5, **SMALL
    ),
    "switch, diagonal, 5 Hz": SceneOptions(object="switch", rate_hz=5.0, revolutions=2.0, seed=6, **SMALL),
    "camera, topdown, 0.5 Hz": SceneOptions(
        object="camera", view="topdown", rate_hz=0.5, revolutions=1.0, seed=7, **SMALL
    ),
    "camera, sideon, 1 Hz, 10 x the noise": SceneOptions(
        object="camera",
        view="sideon",
        rate_hz=1.0,
        revolutions=1.0,
        seed=8,
        sensor=SensorOptions(leak_hz=0.5, shot_hz=0.5),
        **SMALL,
    ),
}

PRINTED = {
    "shapes": {
        "HASTE": ((0.98, 1.73, 2.37), (0.861, 0.671, 0.646)),
        "Metavision": ((0.17, 0.17, 0.17), (0.007, 0.007, 0.007)),
        "eCDT": ((1.78, 2.47, 2.94), (1.518, 1.309, 1.224)),
        "ETC": ((0.88, 1.26, 1.70), (0.524, 0.401, 0.332)),
    },
    "poster": {
        "HASTE": ((1.17, 1.78, 2.30), (0.705, 1.186, 1.699)),
        "Metavision": ((0.13, 0.13, 0.13), (0.005, 0.005, 0.005)),
        "eCDT": ((1.71, 2.32, 2.69), (0.841, 0.814, 0.795)),
        "ETC": ((0.95, 1.66, 2.38), (0.641, 0.497, 0.499)),
    },
    "boxes": {
        "HASTE": ((1.10, 1.68, 2.21), (0.524, 0.721, 0.904)),
        "Metavision": ((0.13, 0.13, 0.18), (0.005, 0.005, 0.005)),
        "eCDT": ((1.42, 1.90, 2.12), (0.728, 0.719, 0.707)),
        "ETC": ((0.88, 1.56, 2.23), (0.738, 0.702, 0.525)),
    },
}
"""RMSE in px and mean feature age in s at the thresholds of 3, 5 and 7 px, as the paper prints them."""

PACKET_NS = 1_000_000

CORNER_PX = 3.0
"""A true corner is tracked while a good track is so near."""


@dataclass(frozen=True)
class Run:
    """Tracks of one recording with one preset.

    delay_s: (N,) from the mean time of a row to the time of the stream at which it came out. seconds: CPU time.
    """

    tracks: Tracks
    delay_s: NDArray[np.float64]
    seconds: float


def row(*cells: object) -> None:
    """Print a row of a table."""
    print(f"| {' | '.join(map(str, cells))} |", flush=True)


def track(events: EventArray, camera: Camera, options: FrontendOptions) -> Run:
    """Run the front-end in packets of 1 ms."""
    frontend = Frontend(camera, options)
    edges = np.arange(events["t"][0], events["t"][-1], PACKET_NS)[1:]
    packets = np.split(events, np.searchsorted(events["t"], edges))
    tracks, delays = [], []
    begin = time.process_time()
    for packet, now in zip(packets, [*edges, events["t"][-1]], strict=True):
        rows = frontend.process(packet).tracks.observations
        tracks.append(rows)
        delays.append(now - rows.t)
    tracks.append(frontend.flush().tracks.observations)
    seconds = time.process_time() - begin
    return Run(Tracks.concatenate(tracks), np.concatenate(delays) / NS_PER_S, seconds)


def tracked_corners(scene: Scene, fitted: FittedTracks, times: NDArray[np.int64]) -> tuple[float, float]:
    """Return the mean number of visible true corners at `times` (N,) ns, and the share that a good track is near."""
    model, camera = scene.simulation.model, scene.camera
    points = corner_vertices(model)
    place = places(fitted, times)
    seen, near = 0, 0
    for k, t in enumerate(times):
        uv, shown = visible(model, points, camera, scene.motion.pose(float(t)))
        at = place[k][np.isfinite(place[k]).all(axis=1)]
        seen += int(shown.sum())
        if len(at) and shown.any():
            near += int((np.linalg.norm(uv[shown][:, None] - at[None], axis=2).min(axis=1) <= CORNER_PX).sum())
    return seen / len(times), near / max(seen, 1)


def spinning(presets: dict[str, FrontendOptions]) -> None:
    """Print a row for each scene of the laboratory and preset."""
    row(
        "scene",
        "preset",
        "tracks",
        "good",
        "RMS <= 3 px",
        "RMS px",
        "pull",
        "age s: median, mean",
        "turned deg",
        "oldest",
    )
    row(*["---"] * 10)
    second = []
    for name, options in SCENES.items():
        scene = simulate(options)
        events = np.concatenate(list(scene.chunks()))
        times = np.linspace(events["t"][0], events["t"][-1], 32)[1:-1].astype(np.int64)
        least = 0
        for preset, values in presets.items():
            run = track(events, scene.camera, values)
            fitted = fit_tracks(run.tracks, scene.camera, poses_of(scene.motion))
            good, age = fitted.good, np.sort(fitted.age[fitted.good])[::-1]
            least = least or len(age)
            seen, share = tracked_corners(scene, fitted, times)
            at_a_time = age.sum() * NS_PER_S / np.ptp(events["t"])
            delay = "" if not len(run.delay_s) else f"{1e3 * np.median(run.delay_s):.0f}, {1e3 * run.delay_s.max():.0f}"
            cost = f"{run.seconds:.1f}"
            second.append(
                (name, preset, f"{at_a_time:.1f}", f"{seen:.0f}", f"{100 * share:.0f} %", len(run.tracks), delay, cost)
            )
            if not len(age):
                row(name, preset, len(good), "none", *[""] * 6)
                continue
            row(
                name,
                preset,
                len(good),
                f"{100 * good.mean():.1f} %",
                f"{100 * ((fitted.rms <= CORNER_PX) & fitted.front).mean():.1f} %",
                f"{np.median(fitted.rms):.2f}",
                f"{fitted.pull(good):.2f}",
                f"{np.median(age):.3f}, {age.mean():.3f}",
                f"{360 * options.rate_hz * np.median(age):.0f}, {360 * options.rate_hz * age.mean():.0f}",
                f"{age[:least].mean():.3f} s",
            )
    print()
    row("scene", "preset", "good at a time", "corners seen", "tracked", "rows", "delay ms", "CPU s")
    row(*["---"] * 8)
    for cells in second:
        row(*cells)


def handheld(presets: dict[str, FrontendOptions], seconds: float) -> None:
    """Print the paper's protocol on twins of the Event Camera Dataset, beside the numbers that the paper prints."""
    print()
    row("scene", "method", "RMSE px at 3, 5, 7", "mean age s at 3, 5, 7", "median age s", "tracks", "off true corners")
    row(*["---"] * 7)
    for name, printed in PRINTED.items():
        scene = handheld_scene(HandheldOptions(scene=name, duration_s=seconds))
        events = np.concatenate(list(scene.simulation.chunks()))
        camera = scene.simulation.camera
        for method, (rmse, age) in printed.items():
            row(name, f"{method}, as printed", *(", ".join(map(str, values)) for values in (rmse, age)), "", "", "")
        for preset, values in presets.items():
            fitted = fit_tracks(track(events, camera, values).tracks, camera, poses_of(scene.trajectory))
            inside = [(fitted.rms <= limit) & fitted.front for limit in (3, 5, 7)]
            off = ""
            if name == "shapes":
                off = offset_to_corners(fitted, corners(scene.simulation.model), camera, scene.trajectory)
            row(
                name,
                preset,
                ", ".join(f"{fitted.rms[i].mean():.2f}" for i in inside),
                ", ".join(f"{fitted.age[i].mean():.3f}" for i in inside),
                ", ".join(f"{np.median(fitted.age[i]):.3f}" for i in inside),
                ", ".join(f"{i.sum()}" for i in inside) + f" of {len(fitted.count)}",
                off,
            )


def main() -> None:
    """Run both parts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=4.0, help="length of the hand-held recordings, s")
    parser.add_argument("--handheld", action="store_true", help="only these")
    parser.add_argument("-p", action="append", default=[], metavar="NAME:=VALUE", help="option of the default preset")
    arguments = parser.parse_args()
    print_provenance()
    presets = {
        "paper": PRESETS["paper"],
        "clusters": replace(PRESETS["default"], {"tracker": "clusters"}),
        "default": replace(PRESETS["default"], parse_assignments(arguments.p)),
    }
    for options in presets.values():
        warm_up(options)
    if not arguments.handheld:
        spinning(presets)
    handheld(presets, arguments.seconds)


if __name__ == "__main__":
    main()
