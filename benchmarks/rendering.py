"""How fast frames are rendered: prints the table of docs/datasets.md."""

from __future__ import annotations

import argparse
import importlib.util
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import trimesh
from provenance import print_provenance
from tqdm import tqdm

from esfo_core.camera import Camera
from esfo_core.orbit import rotation
from esfo_simulation.objects.catalogue import OBJECTS
from esfo_simulation.render.renderer import Light, Renderer, Window
from esfo_simulation.render.surface import Model

SIZES = ((346, 260), (640, 480), (1280, 720))
AXIS, DISTANCE = np.array([0.3, -0.7, -0.6]) / np.linalg.norm([0.3, -0.7, -0.6]), 3.0
BLUR_PX = 0.65
LENS = np.array([-0.3, 0.1, 1e-3, -1e-3, 0.0])


def models() -> dict[str, Model]:
    """All objects and a sphere of small faces, each with its farthest corner 1 m from the centre."""
    sphere = trimesh.creation.icosphere(5)
    albedo = np.random.default_rng(1).uniform(0.1, 0.9, len(sphere.faces))
    found = {name: make(1) for name, make in OBJECTS.items()}
    found["sphere"] = Model(sphere.vertices.view(np.ndarray), sphere.faces.astype(np.int32), albedo)
    for name, model in found.items():
        centred = model.vertices - model.vertices.mean(axis=0)
        found[name] = Model(centred / np.linalg.norm(centred, axis=1).max(), model.faces, model.albedo)
    return found


def pose(k: int) -> np.ndarray:
    """Attitude of frame k: a turn in 30 frames."""
    return rotation(AXIS, 2 * np.pi * k / 30)


def setting(size: tuple[int, int], lens: bool) -> tuple[Camera, Window]:
    """Camera and window in which a sphere of radius 1 m covers 83 % of the height."""
    width, height = size
    focal = 0.415 * height * np.sqrt(DISTANCE**2 - 1)
    K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    side = int(0.83 * height) + 8
    return Camera(width, height, K, "plumb_bob", LENS if lens else np.zeros(0)), Window(
        (width - side) // 2, (height - side) // 2, side, side
    )


def cpu_ms(draw: Callable[[int], object], frames: int) -> float:
    """CPU ms per frame of one thread: the mean of a turn, of each frame the best of three."""
    times = np.empty((4, frames))
    for turn, k in np.ndindex(*times.shape):
        begin = time.thread_time()
        draw(k)
        times[turn, k] = time.thread_time() - begin
    return 1e3 * float(times[1:].min(axis=0).mean())


def wall_ms(draw: Callable[[int], object], frames: int, threads: int) -> float:
    """Wall clock ms per frame in so many threads, the best of three turns."""
    best = np.inf
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(3):
            begin = time.perf_counter()
            list(pool.map(draw, range(frames)))
            best = min(best, time.perf_counter() - begin)
    return 1e3 * best / frames


def ray_caster(model: Model, camera: Camera, window: Window) -> Callable[[int], np.ndarray] | None:
    """The same frames by Embree, 2 x 2 rays per pixel, unblurred; None where embreex is not installed."""
    if importlib.util.find_spec("embreex") is None:
        return None
    rtcore_scene = importlib.import_module("embreex.rtcore_scene")
    mesh_construction = importlib.import_module("embreex.mesh_construction")
    scene = rtcore_scene.EmbreeScene()
    mesh_construction.TriangleMesh(scene, model.vertices[model.faces].astype(np.float32))
    u, v = (o - 0.25 + np.arange(2 * n) / 2 for o, n in ((window.x, window.width), (window.y, window.height)))
    uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    rays = np.column_stack([camera.unproject(uv), np.ones(len(uv))]).astype(np.float32)
    normals, light = model.normals(), Light()

    def draw(k: int) -> np.ndarray:
        # The rays are turned instead of the model, so that the tree is built once.
        R = pose(k)
        directions = rays @ R.astype(np.float32)
        origin = np.broadcast_to((-R.T @ [0, 0, DISTANCE]).astype(np.float32), rays.shape).copy()
        facing = np.maximum(normals @ (R.T @ np.array(light.direction)), 0)
        shade = np.append(model.albedo * (light.ambient + light.diffuse * facing), light.background)
        image = shade[scene.run(origin, directions)].reshape(window.height, 2, window.width, 2)
        return np.asarray(np.log(image.mean(axis=(1, 3))))

    return draw


def row(name: str, model: Model, size: tuple[int, int], frames: int) -> str:
    """One row of the table."""
    cells = [name, str(len(model.faces)), f"{size[0]}x{size[1]}"]
    for lens in (False, True):
        camera, window = setting(size, lens)
        renderer = Renderer(model, camera, window, Light(), BLUR_PX)

        def draw(k: int, renderer: Renderer = renderer) -> np.ndarray:
            return renderer.render(pose(k), np.array([0, 0, DISTANCE]))

        one = cpu_ms(draw, frames)
        cells.append(f"{one:.1f}")
        if not lens:
            walls = [wall_ms(draw, frames, threads) for threads in (1, 2)]
            cells.append(f"{walls[0] / walls[1]:.2f}")
            cast = ray_caster(model, camera, window)
            cells.append(f"{cpu_ms(cast, 3) / one:.1f}" if cast else "not installed")
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=30, help="frames per measurement (default %(default)s)")
    parser.add_argument("--objects", nargs="*", help="names of objects (default: all)")
    frames, names = (args := parser.parse_args()).frames, args.objects
    print_provenance()
    print(
        "| object | faces | sensor | CPU ms per frame | two threads: speed-up | Embree, of ours | with a lens, CPU ms |"
    )
    print("|---|---|---|---|---|---|---|")
    chosen = [(name, model) for name, model in models().items() if not names or name in names]
    for (name, model), size in tqdm([(c, s) for c in chosen for s in SIZES], disable=None, leave=False):
        tqdm.write(row(name, model, size, frames))


if __name__ == "__main__":
    main()
