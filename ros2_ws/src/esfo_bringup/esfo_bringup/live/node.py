"""ROS node of a live run: starts replay, front-end and back-end, collects what they publish, checks for losses."""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import rclpy
from esfo_msgs.msg import EventActivity, FeatureTracks, OrbitEstimate
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from tqdm import tqdm

from esfo_backend.ros import messages
from esfo_bringup.commands.arguments import report, settings_of, source_of
from esfo_bringup.commands.live import add_live_arguments
from esfo_bringup.errors import CommandError, error_line
from esfo_bringup.live.processes import NodeProcess, NodeProcesses
from esfo_bringup.offline.pipeline import RunResult
from esfo_bringup.offline.source import Source, with_source
from esfo_bringup.result_bag.opening import bag_path
from esfo_bringup.results.event_image import EventImage
from esfo_bringup.results.files import write_results
from esfo_bringup.settings import share_out
from esfo_core.activity import Activity
from esfo_core.activity_pyramid import BINS as PYRAMID_BINS
from esfo_core.errors import EsfoError
from esfo_core.estimate import WITH_MOTION
from esfo_core.estimate_text import one_line
from esfo_core.events import NS_PER_S
from esfo_core.options import parse_assignments
from esfo_core.tracks import Tracks
from esfo_ros.entry_point import start_ros

_START_S = 120.0
_SETTLE_S = 60.0
_SOLVE_S = 600.0
_ANSWER_S = 60.0
"""Time after which a service is called again: a node that discovers the client too late cannot send its answer."""
_EVERYTHING = QoSProfile(depth=100_000)
_LOSSLESS_FRONTEND: dict[str, object] = {
    "events.reliability": "reliable",
    "events.depth": 100_000,
    "queue": 1_000_000,
    "wait_for_back_end": True,
    "min_listeners": 2,  # the back-end and the collector
    "idle_flush_s": 0.0,
    # Messages are kept, not overwritten, while the back-end or the collector gets no processor time.
    **{f"qos_overrides./{topic}.publisher.depth": 100_000 for topic in ("feature_tracks", "event_activity")},
}
"""Parameters with which the front-end loses no message and ends its stream only when told to."""
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class CollectorNode(Node):  # type: ignore[misc]
    """Keeps the tracks, the activity and the latest orbit, and calls the services of the other nodes."""

    def __init__(self, bar: tqdm[NoReturn]) -> None:
        super().__init__("collector")
        self.tracks: list[Tracks] = []
        self.activity: list[Activity] = []
        self.orbit: OrbitEstimate | None = None
        self.orbits = 0
        self.points: PointCloud2 | None = None
        self._bar = bar
        self.create_subscription(FeatureTracks, "feature_tracks", self._on_tracks, _EVERYTHING)
        self.create_subscription(EventActivity, "event_activity", self._on_activity, _EVERYTHING)
        self.create_subscription(OrbitEstimate, "orbit", self._on_orbit, _LATCHED)
        self.create_subscription(PointCloud2, "points", self._on_points, _LATCHED)

    @property
    def observations(self) -> int:
        """Number of observations received."""
        return sum(len(t) for t in self.tracks)

    def _on_tracks(self, message: FeatureTracks) -> None:
        self.tracks.append(messages.update_from(message).observations)

    def _on_activity(self, message: EventActivity) -> None:
        if message.bin in PYRAMID_BINS:
            return  # of other resolutions than that of the rate over time
        self.activity.append(messages.activity_from(message))
        self._bar.update((message.t0 - self.activity[0].t0) / NS_PER_S - self._bar.n)

    def _on_points(self, message: PointCloud2) -> None:
        self.points = message

    def _on_orbit(self, message: OrbitEstimate) -> None:
        self.orbit = message
        self.orbits += 1
        seen = (message.t_last - message.t_first) / NS_PER_S
        tqdm.write(f"{seen:7.2f} s  {one_line(messages.estimate_from(message, None), message.points)}")

    def spin_until(self, done: Callable[[], bool], processes: NodeProcesses, timeout_s: float, what: str) -> None:
        """Handle messages until `done`. Raises CommandError when a process dies or the time is over."""
        end = time.monotonic() + timeout_s
        while not done():
            rclpy.spin_once(self, timeout_sec=0.1)
            processes.check()
            if time.monotonic() > end:
                raise CommandError(f"{what} took more than {timeout_s:.0f} s")

    def ask(self, service: str, processes: NodeProcesses, timeout_s: float) -> dict[str, str]:
        """Call a Trigger service; return the `name=value` words of its answer."""
        client = self.create_client(Trigger, service)
        calls: list[tuple[float, Future]] = []

        def answered() -> bool:
            if not calls or time.monotonic() > calls[-1][0] + _ANSWER_S:
                calls.append((time.monotonic(), client.call_async(Trigger.Request())))
            return any(call.done() for _, call in calls)

        try:
            self.spin_until(client.service_is_ready, processes, _START_S, f"finding {service}")
            self.spin_until(answered, processes, timeout_s, service)
        finally:
            self.destroy_client(client)
        message = next(call.result().message for _, call in calls if call.done())
        return dict(word.split("=", 1) for word in message.split() if "=" in word)


def run_live(source: Source, args: argparse.Namespace, folder: Path) -> tuple[RunResult, list[Activity]]:
    """Play the recording through the nodes; return the result and the activity.

    Raises CommandError when anything was lost or a node died.
    """
    with (
        tqdm(desc="live", unit=" s", disable=None, bar_format="{desc}: {n:.1f} s of the recording | {elapsed}") as bar,
        NodeProcesses(folder) as processes,
    ):
        collector = CollectorNode(bar)
        replay = _start(source, args, folder, processes)
        collector.spin_until(lambda: replay.exit_code() == 0, processes, float("inf"), "replay")
        _finish(collector, replay, processes)
        assert collector.orbit is not None
        estimate = messages.estimate_from(collector.orbit, collector.points)
        collector.destroy_node()
    tracks = Tracks.concatenate(collector.tracks).sorted()
    return RunResult(with_source(estimate, source), tracks, None, ""), collector.activity


def _start(source: Source, args: argparse.Namespace, folder: Path, processes: NodeProcesses) -> NodeProcess:
    """Start the three nodes, configured so that no message may be lost; return the replay."""
    camera = folder / "camera.yaml"
    source.camera.write_yaml(camera)
    chosen = share_out(parse_assignments(args.set))
    processes.start(
        "esfo_backend",
        "backend_node",
        {"preset": args.preset, "use_sim_time": True, "idle_solve_s": 0.0, **chosen.backend},
    )
    processes.start(
        "esfo_frontend",
        "frontend_node",
        {"preset": args.preset, **_LOSSLESS_FRONTEND, **chosen.frontend},
    )
    recording = source.recording
    size = {"width": recording.width, "height": recording.height}
    topic = {} if args.topic is None else {"topic": args.topic}
    return processes.start(
        "esfo_bringup",
        "replay_node",
        {
            "recording": recording.path.absolute(),
            **topic,
            **{f"reading.{name}": value for name, value in {**chosen.reading, **size}.items()},
            "camera": camera,
            "rate": args.rate,
            "wait_timeout_s": _START_S,
        },
    )


def _finish(collector: CollectorNode, replay: NodeProcess, processes: NodeProcesses) -> None:
    """Have the front-end end its tracks and the back-end solve with all of them."""
    published = re.search(r"published (\d+) packets", replay.log())
    flushed = collector.ask("frontend/flush", processes, _SOLVE_S)
    if published is None or flushed["packets"] != published[1]:
        sent = published[1] if published else "an unknown number of"
        raise CommandError(f"the front-end received {flushed['packets']} of {sent} packets")
    rows = int(flushed["observations"])
    collector.spin_until(lambda: collector.observations >= rows, processes, _SETTLE_S, "receiving the last tracks")
    end = time.monotonic() + _SETTLE_S
    while True:
        before = collector.orbits
        solved = collector.ask("backend/solve", processes, _SOLVE_S)
        if all(solved[name] == flushed[name] for name in ("observations", "activity_bins")):
            break
        if time.monotonic() > end:
            raise CommandError(f"the back-end received {solved['observations']} of {rows} observations")
    collector.spin_until(lambda: collector.orbits > before, processes, _SETTLE_S, "receiving the orbit")
    orbit = collector.orbit
    if orbit is not None and orbit.level in WITH_MOTION:
        collector.spin_until(
            lambda: collector.points is not None and collector.points.header.stamp == orbit.header.stamp,
            processes,
            _SETTLE_S,
            "receiving the points",
        )


def main() -> int:
    """Run a live session with the arguments of `esfo live`."""
    parser = argparse.ArgumentParser(prog="esfo live")
    add_live_arguments(parser)
    args = parser.parse_args()
    try:
        start_ros(args=[])
        settings_of(args)
        source = source_of(args)
        bag = bag_path(args.output, source)
        with tempfile.TemporaryDirectory(prefix="esfo_live_") as folder:
            result, activity = run_live(source, args, Path(folder))
        event_image = EventImage(source.recording.width, source.recording.height)
        for events in source.recording.chunks():
            event_image.add(events)
        write_results(result, source, event_image, activity, args.output)
        bag.unlink(missing_ok=True)  # an earlier `esfo run` wrote it, with another result
        return report(result, args.output)
    except EsfoError as error:
        sys.stderr.write(error_line(error))
        return 1
    except KeyboardInterrupt:
        return 130  # the command that started this session reports it
    finally:
        rclpy.try_shutdown()
