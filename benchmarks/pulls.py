"""Whether deviations hold: error over deviation of rate and axis, of small scenes with what disturbs a laboratory.

Scenes are simulated once each; disturbances are drawn anew for every run and laid over the events: a camera that
trembles (two frequencies, or at random), a passer-by, spots that glitter, noise of the sensor, lost packets. A pull of
the axis is its Mahalanobis distance over the root of two, so that one is what is expected of both.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from esfo_backend.options import BackendOptions, InitialisationOptions
from esfo_bringup.benchmark.orbit_accuracy import backend_of, track
from esfo_core.estimate import OrbitEstimate
from esfo_core.events import EventArray
from esfo_core.orbit import NS_PER_S, tangent_basis
from esfo_simulation.objects.catalogue import OBJECTS
from esfo_simulation.scene import VIEWS, Scene, SceneOptions, simulate

Random = np.random.Generator
Disturbance = Callable[[EventArray, Scene, Random], EventArray]

_CHUNK = 20_000
_ANOTHER_RATE = 100.0
"""Pull beyond which a rate is not inaccurate, but another one."""
_DIRECT = BackendOptions(initialisation=InitialisationOptions(method="direct"))


def undisturbed(events: EventArray, _: Scene, rng: Random) -> EventArray:
    """Lose five of a hundred events, so that no two runs are the same."""
    return events[rng.random(len(events)) > 0.05]


def trembling(events: EventArray, scene: Scene, rng: Random) -> EventArray:
    """Shift the image by two sinusoids of 0.3 to 1.2 px together, 3 to 20 cycles a turn."""
    turns = (events["t"] - events["t"][0]) / NS_PER_S * scene.spin.rate_hz
    size = rng.uniform(0.3, 1.2) / 2
    shift = np.zeros((len(events), 2))
    for cycles in rng.uniform(3, 20, 2):
        phase, direction = rng.uniform(0, 2 * np.pi, 2)
        wave = size * np.sin(2 * np.pi * cycles * turns + phase)
        shift += wave[:, None] * [np.cos(direction), np.sin(direction)]
    return shifted(events, shift, scene, rng)


def shaken(events: EventArray, scene: Scene, rng: Random) -> EventArray:
    """Shift the image at random, by 0.2 to 0.6 px that last a twentieth of a turn."""
    turns = (events["t"] - events["t"][0]) / NS_PER_S * scene.spin.rate_hz
    keep, step = np.exp(-0.05), 0.0025
    walk = np.zeros((int(turns[-1] / step) + 2, 2))
    for k in range(1, len(walk)):
        walk[k] = keep * walk[k - 1] + np.sqrt(1 - keep**2) * rng.normal(size=2)
    size, grid = rng.uniform(0.2, 0.6), step * np.arange(len(walk))
    return shifted(events, size * np.stack([np.interp(turns, grid, w) for w in walk.T], axis=1), scene, rng)


def passed_by(events: EventArray, scene: Scene, rng: Random) -> EventArray:
    """Let a dotted disc of a sixth of the image cross it within half a turn, in front of the object."""
    width, height = scene.camera.width, scene.camera.height
    radius = width / 12
    begin = int(events["t"][0] + rng.uniform(0, 0.8) * np.ptp(events["t"]))
    length = 0.5 * NS_PER_S / scene.spin.rate_hz
    y, direction = rng.uniform(0.2, 0.8) * height, rng.choice([-1, 1])

    def middle(t: NDArray[np.int64]) -> NDArray[np.float64]:
        part = (t - begin) / length
        return np.stack([width * (0.5 + direction * (part - 0.5)), np.full(len(t), y)], axis=1)

    inside = (events["t"] >= begin) & (events["t"] < begin + length)
    inside[inside] = np.linalg.norm(places(events[inside]) - middle(events["t"][inside]), axis=1) < radius
    dots = rng.uniform(-0.7, 0.7, (60, 2)) * radius
    t = np.sort(rng.uniform(begin, begin + length, 60 * width)).astype(np.int64)
    edge = rng.integers(0, 2, len(t))  # a dot darkens ahead of it and brightens behind
    at = middle(t) + dots[rng.integers(0, len(dots), len(t))] + np.stack([direction * (1.5 - 3 * edge), 0 * edge], 1)
    return merged(events[~inside], t, at + rng.normal(0, 0.4, at.shape), edge, scene)


def glittering(events: EventArray, scene: Scene, rng: Random) -> EventArray:
    """Let 20 spots that stand still flash whenever the object passes through them."""
    spots = places(events[rng.integers(0, len(events), 20)]).astype(float)
    near = np.zeros(len(events), bool)
    for spot in spots:
        near |= np.abs(places(events) - spot).max(axis=1) <= 1
    near &= rng.random(len(events)) < 0.5
    at = places(events[near]) + rng.integers(-1, 2, (int(near.sum()), 2))
    return merged(events, events["t"][near] + 1000, at, rng.integers(0, 2, len(at)), scene)


def noisy(events: EventArray, scene: Scene, rng: Random) -> EventArray:
    """Add a fifth as many events anywhere, and ten pixels that fire all the time."""
    width, height = scene.camera.width, scene.camera.height
    count, hot = len(events) // 5, 10
    at = np.stack([rng.integers(0, width, count), rng.integers(0, height, count)], axis=1)
    at[: count // 20] = at[rng.integers(0, hot, count // 20)]
    t = rng.integers(events["t"][0], events["t"][-1], count)
    return merged(events, t, at, rng.integers(0, 2, count), scene)


def torn(events: EventArray, scene: Scene, rng: Random) -> EventArray:
    """Lose 3 of 100 packets of a hundredth of a turn."""
    packet = ((events["t"] - events["t"][0]) / NS_PER_S * scene.spin.rate_hz * 100).astype(np.int64)
    return events[(rng.random(packet[-1] + 1) > 0.03)[packet]]


_HEADER = """| disturbance | runs | ok | of another rate | pull of the rate: RMS, largest, below 3 | of the axis |
|---|---|---|---|---|---|"""

DISTURBANCES: dict[str, Disturbance] = {
    "none": undisturbed,
    "trembling camera": trembling,
    "shaken camera": shaken,
    "passer-by": passed_by,
    "glitter": glittering,
    "noise": noisy,
    "lost packets": torn,
}


def places(events: EventArray) -> NDArray[np.int64]:
    """Pixels (N, 2)."""
    return np.stack([events["x"], events["y"]], axis=1).astype(np.int64)


def shifted(events: EventArray, shift: NDArray[np.float64], scene: Scene, rng: Random) -> EventArray:
    """Move events by a shift (N, 2) px, rounded up or down by chance; what leaves the image is lost."""
    exact = places(events) + shift
    low = np.floor(exact)
    xy = (low + (rng.random(exact.shape) < exact - low)).astype(np.int64)
    kept = ((xy >= 0) & (xy < [scene.camera.width, scene.camera.height])).all(axis=1)
    out = events[kept].copy()
    out["x"], out["y"] = xy[kept].T
    return out


def merged(
    events: EventArray, t: NDArray[np.int64], at: NDArray[np.generic], p: NDArray[np.int64], scene: Scene
) -> EventArray:
    """Add events at times t (N,), pixels (N, 2) and of polarities p (N,)."""
    xy = np.rint(at).astype(np.int64)
    kept = ((xy >= 0) & (xy < [scene.camera.width, scene.camera.height])).all(axis=1)
    added = np.zeros(int(kept.sum()), events.dtype)
    added["t"], added["p"] = t[kept], p[kept]
    added["x"], added["y"] = xy[kept].T
    both = np.concatenate([events, added])
    return both[np.argsort(both["t"], kind="stable")]


def scenes(count: int) -> Iterable[Scene]:
    """Objects and views in turn, each with another phase, rate and pattern."""
    rng = np.random.default_rng(0)
    names, views = tuple(OBJECTS), tuple(VIEWS)
    for k in range(count):
        options = SceneOptions(
            object=names[k % len(names)],
            view=views[(k + k // len(names)) % len(views)],
            rate_hz=float(rng.uniform(0.5, 2.0)),
            revolutions=2.6,
            width=200,
            height=150,
            phase_deg=float(rng.uniform(0, 360)),
            seed=k,
        )
        yield simulate(options)


def solve(events: EventArray, scene: Scene) -> OrbitEstimate:
    """Run the pipeline, without COLMAP, which has no part in deviations."""
    chunks = np.array_split(events, max(1, len(events) // _CHUNK))
    return backend_of(track(chunks, scene.camera), scene.camera, _DIRECT).solve()


def pulls(estimate: OrbitEstimate, scene: Scene) -> tuple[float, float] | None:
    """Errors of rate and axis over their deviations; None where the verdict leaves either open."""
    if estimate.status != "ok" or estimate.spin is None:
        return None
    off = tangent_basis(estimate.spin.axis).T @ scene.spin.axis
    axis = np.sqrt(off @ np.linalg.solve(estimate.axis_cov, off) / 2)
    return (estimate.spin.rate_hz - scene.spin.rate_hz) / estimate.rate_std_hz, float(axis)


def line(name: str, runs: int, found: list[tuple[float, float]]) -> str:
    """Row of a table; what is another rate than the true one, a multiple, is counted and is no pull."""
    every = np.abs(np.reshape(found, (-1, 2)))
    another = every[:, 0] > _ANOTHER_RATE
    cells = [str(int(another.sum()))]
    for values in every[~another].T:
        rms, share = (np.sqrt(np.mean(values**2)), np.mean(values < 3)) if len(values) else (np.nan, np.nan)
        cells.append(f"{rms:.2f}, {values.max(initial=0.0):.1f}, {share:.1%}")
    return f"| {name} | {runs} | {len(found)} | {' | '.join(cells)} |"


def main() -> None:
    """Print a row for each disturbance, and one for all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300, help="runs, of all disturbances together")
    parser.add_argument("--scenes", type=int, default=12, help="scenes that they are laid over")
    args = parser.parse_args()
    each = -(-args.count // (args.scenes * len(DISTURBANCES)))
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in DISTURBANCES}
    rng = np.random.default_rng(1)
    for scene in scenes(args.scenes):
        events = np.concatenate(list(scene.chunks()))
        for name, disturb in DISTURBANCES.items():
            for _ in range(each):
                pull = pulls(solve(disturb(events, scene, rng), scene), scene)
                found[name] += [] if pull is None else [pull]
    print(_HEADER)
    for name, values in found.items():
        print(line(name, each * args.scenes, values))
    print(line("all", each * args.scenes * len(DISTURBANCES), [pull for values in found.values() for pull in values]))


if __name__ == "__main__":
    main()
