"""Where the time goes, from events to orbit, on a simulated scene: prints the tables of docs/benchmarks.md."""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Callable

import numpy as np
from provenance import print_provenance

from esfo_backend.backend import Backend
from esfo_backend.options import PRESETS as BACKEND_PRESETS
from esfo_core.camera import Camera
from esfo_core.events import NS_PER_S, EventArray
from esfo_core.orbit import angle_between
from esfo_frontend.corners.detector import CornerDetector
from esfo_frontend.frontend import Frontend
from esfo_frontend.options import PRESETS as FRONTEND_PRESETS
from esfo_simulation.scene import SceneOptions, simulate


def cpu(work: Callable[[], object]) -> float:
    """CPU seconds of this process that `work` takes."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def front_end(events: EventArray, camera: Camera, preset: str) -> tuple[Frontend, Backend, float]:
    """Run the front-end in packets of 10 ms; return it, a back-end with its output, and the CPU seconds."""
    frontend = Frontend(camera, FRONTEND_PRESETS[preset])
    backend = Backend(camera, BACKEND_PRESETS[preset])
    edges = np.arange(events["t"][0], events["t"][-1] + 10_000_000, 10_000_000)
    packets = np.split(events, np.searchsorted(events["t"], edges[1:]))

    def run() -> None:
        for packet in packets:
            output = frontend.process(packet)
            backend.add(output.tracks, output.activity, output.pyramid)
        output = frontend.flush()
        backend.add(output.tracks, output.activity, output.pyramid)

    return frontend, backend, cpu(run)


def pipeline(revolutions: float) -> None:
    """Time both presets on one simulated scene, beside its truth."""
    simulation = simulate(SceneOptions(revolutions=revolutions))
    chunks: list[EventArray] = []
    seconds = cpu(lambda: chunks.extend(simulation.chunks()))
    events = np.concatenate(chunks)
    length = (events["t"][-1] - events["t"][0]) / NS_PER_S
    camera, truth = simulation.camera, simulation.spin
    print(
        f"scene: {len(events) / 1e6:.2f} M events, {length:.2f} s, {camera.width}x{camera.height}, {seconds:.1f} CPU s"
    )
    front_end(events[: len(events) // 20], camera, "default")  # compiles
    corners = cpu(
        lambda: CornerDetector(camera.width, camera.height, FRONTEND_PRESETS["default"].corners).detect(events)
    )
    print(f"eFAST alone: {len(events) / corners / 1e6:.2f} Mev per CPU s\n")
    print(
        "| preset | front-end, CPU s | of real time | Mev/s | corners | tracks | back-end | rate off by | axis off by |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for preset in ("default", "paper"):
        frontend, backend, took = front_end(events, camera, preset)
        s = frontend.statistics
        estimate = backend.solve()
        row = (
            f"| {preset} | {took:.1f} | {took / length:.1f} x | {len(events) / took / 1e6:.2f} | {s.kept} | {s.tracks} "
        )
        stages = ", ".join(f"{name} {value:.2f} s" for name, value in estimate.timing_s.items())
        if estimate.spin is None:
            print(f"{row}| {stages} | {estimate.reason} | |")
            continue
        rate = 100 * (estimate.spin.rate_hz / truth.rate_hz - 1)
        axis = angle_between(estimate.spin.axis, truth.axis)
        print(f"{row}| {stages}, {estimate.initialisation} | {rate:+.4f} % | {axis:.3f} deg |")


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--revolutions", type=float, default=2.5)
    revolutions = parser.parse_args().revolutions
    print_provenance()
    pipeline(revolutions)
    print(f"\nPeak memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


if __name__ == "__main__":
    main()
