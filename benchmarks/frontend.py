"""The front-end as a whole: speed of its stages, memory, growth and delay; prints tables of docs/benchmarks.md."""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rclpy
from detectors import GEN4, moving_rectangles
from esfo_msgs.msg import FeatureTracks
from event_camera_msgs.msg import EventPacket
from provenance import print_provenance

from esfo_bringup.live.processes import NodeProcesses
from esfo_bringup.replay.messages import packet_message
from esfo_core.camera import SensorSize
from esfo_core.events import EventArray
from esfo_core.options import replace
from esfo_core.recordings import open_recording
from esfo_frontend.frontend import Frontend
from esfo_frontend.options import PRESETS, FrontendOptions
from esfo_frontend.trackers import PIPELINES
from esfo_frontend.warm_up import warm_up
from esfo_simulation.scene import SceneOptions, simulate

PACKET_NS = 4_000_000
STAGES = {
    "detector": ("corners", "detect"),
    "filter": ("_density", "filter_until"),
    "clustering": ("_clusterer", "add_slice"),
    "joining": ("_joiner", "add"),
    "association": ("_association", "add"),
}
OPTIONS = {
    "default": PRESETS["default"],
    "clusters": replace(PRESETS["default"], {"tracker": "clusters"}),
    "paper": PRESETS["paper"],
}
SCENES = {
    "hubble, 0.5 Hz, 480x360": SceneOptions(revolutions=0.5),
    "soho, 3.3 Hz, 346x260": SceneOptions(object="soho", rate_hz=3.3, revolutions=2.0, width=346, height=260),
    "tdrs, 1 Hz, 1280x720": SceneOptions(object="tdrs", rate_hz=1.0, revolutions=0.1, width=1280, height=720),
}

Size = tuple[int, int]


def packets_of(events: EventArray) -> list[EventArray]:
    """Cut events into packets of 4 ms."""
    edges = np.arange(events["t"][0], events["t"][-1], PACKET_NS)[1:]
    return [p for p in np.split(events, np.searchsorted(events["t"], edges)) if len(p)]


@contextmanager
def stopwatches() -> Iterator[dict[str, float]]:
    """Measure the CPU time in each stage of every front-end that is made inside; yields the sums by name."""
    spent: dict[str, float] = defaultdict(float)

    def watch(thing: object, name: str, method: str) -> None:
        inner = getattr(thing, method)

        def timed(*args: object) -> object:
            begin = time.process_time()
            try:
                return inner(*args)
            finally:
                spent[name] += time.process_time() - begin

        setattr(thing, method, timed)

    plain = dict(PIPELINES)
    for key, pipeline in plain.items():

        def begin(*args: object, pipeline: type = pipeline) -> object:
            made = pipeline(*args)
            for name, (part, method) in STAGES.items():
                if hasattr(made, part):
                    watch(getattr(made, part), name, method)
            return made

        PIPELINES[key] = begin  # type: ignore[assignment]
    try:
        yield spent
    finally:
        PIPELINES.update(plain)


def run(events: EventArray, size: Size, options: FrontendOptions) -> tuple[float, float, Frontend]:
    """Run a front-end over packets; return its CPU and wall seconds, and itself."""
    frontend = Frontend(SensorSize(*size), options)
    cpu, wall = time.process_time(), time.perf_counter()
    for packet in packets_of(events):
        frontend.process(packet)
    frontend.flush()
    return time.process_time() - cpu, time.perf_counter() - wall, frontend


def speeds(name: str, events: EventArray, size: Size, most: int) -> None:
    """Print the rows of one stream."""
    for preset, options in OPTIONS.items():
        part = events[: most if preset == "paper" else len(events)]
        with stopwatches() as spent:
            cpu, wall, frontend = run(part, size, options)
        _, wall_of_two, _ = run(part, size, replace(options, {"corners.threads": 2}))
        stages = " | ".join(f"{len(part) / spent[s] / 1e6:.1f}" if spent[s] else "" for s in STAGES)
        seconds = (part["t"][-1] - part["t"][0]) / 1e9
        corners = max(frontend.statistics.corners, 1)
        print(
            f"| {name} | {preset} | {stages} | {len(part) / cpu / 1e6:.2f} | {wall / wall_of_two:.2f} | "
            f"{seconds / cpu:.2f} | {1e6 * (cpu - spent['detector']) / corners:.2f} | {frontend.statistics.tracks} |",
            flush=True,
        )


def peak_of(events: int, spacing: int, queue: multiprocessing.Queue[tuple[int, float, float]]) -> None:
    """Run the default on a generated stream in this process; report its tracks, Mev per CPU second and peak memory."""
    size = (1280, 720)
    warm_up(PRESETS["default"])
    frontend = Frontend(SensorSize(*size))
    spent, made = 0.0, 0
    # The same second over and over, later each time, so that the stream itself takes no memory.
    stream = moving_rectangles(size, 4e6, min(events, 4_000_000), spacing)
    length = int(stream["t"][-1] - stream["t"][0]) + 1000
    while made < events:
        begin = time.process_time()
        for packet in packets_of(stream.copy()):  # a front-end keeps the packets that it still needs
            frontend.process(packet)
        spent += time.process_time() - begin
        made += len(stream)
        stream["t"] += length
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    queue.put((frontend.statistics.tracks, made / spent / 1e6, memory))


def growth(events: float) -> None:
    """Print speed and memory over the length of a stream and over its number of features."""
    print("\n| events, M | px per rectangle | tracks | Mev per CPU s | peak MiB |\n|---|---|---|---|---|")
    context = multiprocessing.get_context("spawn")
    for count, spacing in ((1, 1500), (4, 1500), (16, 1500), (4, 6000), (4, 500)):
        queue: multiprocessing.Queue[tuple[int, float, float]] = context.Queue()
        process = context.Process(target=peak_of, args=(int(count * events * 1e6), spacing, queue))
        process.start()
        tracks, speed, memory = queue.get()
        process.join()
        print(f"| {count * events:g} | {spacing} | {tracks} | {speed:.2f} | {memory:.0f} |", flush=True)


def delay(events: EventArray, size: Size) -> tuple[float, float]:
    """Publish a stream to the node as it happens; return median and 99 % of the delay in ms until tracks come back.

    From the mean time of a row to the arrival of its message, in the time of the stream.
    """
    arrived: list[float] = []
    with tempfile.TemporaryDirectory() as folder, NodeProcesses(Path(folder)) as processes:
        processes.start("esfo_frontend", "frontend_node", {"idle_flush_s": 0.0})
        rclpy.init(args=[])
        node = rclpy.create_node("source")
        publisher = node.create_publisher(EventPacket, "events", 1000)
        begin = 0.0

        def take(message: FeatureTracks) -> None:
            now = int(events["t"][0]) / 1e9 + time.monotonic() - begin
            arrived.extend(now - np.asarray(message.t) / 1e9)

        node.create_subscription(FeatureTracks, "feature_tracks", take, 1000)
        while publisher.get_subscription_count() < 1:
            rclpy.spin_once(node, timeout_sec=0.1)
        messages = [packet_message(p, k, size, "camera") for k, p in enumerate(packets_of(events))]
        ends = [(int(p["t"][-1]) - int(events["t"][0])) / 1e9 for p in packets_of(events)]
        begin = time.monotonic()
        for message, end in zip(messages, ends, strict=True):
            while (left := begin + end - time.monotonic()) > 0:
                rclpy.spin_once(node, timeout_sec=left)
            publisher.publish(message)
        last = time.monotonic() + 1.0
        while time.monotonic() < last:
            rclpy.spin_once(node, timeout_sec=0.05)
        node.destroy_node()
        rclpy.shutdown()
    return 1e3 * float(np.median(arrived)), 1e3 * float(np.quantile(arrived, 0.99))


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--events", type=float, default=2.0, help="millions of events of the generated streams")
    parser.add_argument("--paper-events", type=float, default=0.3, help="millions of events for the paper preset")
    arguments = parser.parse_args()
    print_provenance()
    count, most = int(1e6 * arguments.events), int(1e6 * arguments.paper_events)
    for options in OPTIONS.values():
        warm_up(options)
    streams: dict[str, tuple[Size, EventArray]] = {
        "davis": ((240, 180), moving_rectangles((240, 180), 2e6, count)),
        "hd": ((1280, 720), moving_rectangles((1280, 720), 26e6, count)),
    }
    if GEN4.exists():
        streams["gen4"] = ((1280, 720), np.concatenate(list(open_recording(GEN4).chunks())))
    for name, asked in SCENES.items():
        scene = simulate(asked)
        streams[name] = ((scene.camera.width, scene.camera.height), np.concatenate(list(scene.chunks())))
    print(
        "Mev per CPU second; two threads: wall time of one over that of two; last: us per corner but for detecting.\n"
    )
    print(f"| stream | options | {' | '.join(STAGES)} | whole | two threads | x real time | us per corner | tracks |")
    print(f"|---|---|{'---|' * (len(STAGES) + 5)}")
    for name, (size, events) in streams.items():
        speeds(name, events, size, most)
    growth(arguments.events)
    print("\n| stream through the node | delay, ms, median | 99 % |\n|---|---|---|")
    for name in SCENES:
        median, most_of = delay(streams[name][1], streams[name][0])
        print(f"| {name} | {median:.0f} | {most_of:.0f} |", flush=True)


if __name__ == "__main__":
    main()
