"""The front-end in the ROS graph against the same without ROS; its callback; and the CPU time of idle nodes.

Both take the same serialised packets of at most 4 ms and 16384 events, one after the other as fast as they are worked
on. In the graph they come from another process, what was sent at most 0.3 s of sensor time ahead of what is worked off,
so that nothing is lost.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
from esfo_msgs.msg import EventActivity
from event_camera_msgs.msg import EventPacket
from frontend import SCENES, packets_of
from lifecycle_msgs.srv import ChangeState
from provenance import print_provenance
from rclpy.serialization import serialize_message
from std_srvs.srv import Trigger

from esfo_bringup.live.processes import NodeProcess, NodeProcesses
from esfo_bringup.replay.messages import acknowledged_until, packet_message
from esfo_bringup.replay.player import MAX_EVENTS
from esfo_core.packets import EVENT_PACKET, packet_from_cdr
from esfo_frontend.online.live_frontend import LiveFrontend
from esfo_frontend.options import PRESETS
from esfo_frontend.ros.node import FrontendNode
from esfo_frontend.warm_up import warm_up
from esfo_simulation.scene import simulate

AHEAD_NS = 300_000_000
SLACK_NS = 20_000_000
DEACTIVATE = 4

Stream = list[tuple[bytes, int]]


def stream_of(name: str, least: float) -> tuple[Stream, int]:
    """Return a scene as serialised packets, each with the time of its last event, and the number of events.

    least: millions of events; the scene is repeated until it has so many.
    """
    scene = simulate(SCENES[name])
    size = (scene.camera.width, scene.camera.height)
    once = np.concatenate(list(scene.chunks()))
    length = int(once["t"][-1] - once["t"][0]) + 1000
    events = np.tile(once, int(np.ceil(1e6 * least / len(once))))
    events["t"] += np.repeat(np.arange(len(events) // len(once)) * length, len(once))
    packets = [part for packet in packets_of(events) for part in np.array_split(packet, -(-len(packet) // MAX_EVENTS))]
    serialised = [bytes(serialize_message(packet_message(p, k, size, "camera"))) for k, p in enumerate(packets)]
    return list(zip(serialised, (int(p["t"][-1]) for p in packets), strict=True)), sum(len(p) for p in packets)


def without_ros(stream: Stream) -> float:
    """Return the seconds that the front-end needs for the packets."""
    frontend = LiveFrontend(PRESETS["default"])
    begin = time.perf_counter()
    for data, _ in stream:
        list(frontend.process(packet_from_cdr(EVENT_PACKET, data)))
    list(frontend.flush())
    return time.perf_counter() - begin


def in_graph(stream: Stream) -> float:
    """Return the seconds from the first packet sent until all are worked on. Fails when any was lost."""
    with tempfile.TemporaryDirectory() as folder, NodeProcesses(Path(folder)) as processes:
        parameters = {"events.reliability": "reliable", "events.depth": 10_000, "queue": 10_000, "idle_flush_s": 0.0}
        processes.start("esfo_frontend", "frontend_node", parameters)
        node = rclpy.create_node("source")
        publisher = node.create_publisher(EventPacket, "events", 10_000)
        done = [stream[0][1]]
        node.create_subscription(EventActivity, "event_activity", lambda m: done.append(acknowledged_until(m)), 1000)
        while publisher.get_subscription_count() < 1:
            rclpy.spin_once(node, timeout_sec=0.1)
        settle = time.monotonic() + 1.0
        while time.monotonic() < settle:
            rclpy.spin_once(node, timeout_sec=0.1)
        begin = time.perf_counter()
        for data, last in stream:
            while last > done[-1] + AHEAD_NS:
                rclpy.spin_once(node, timeout_sec=0.1)
            publisher.publish(data)
        while done[-1] < stream[-1][1] - SLACK_NS:
            rclpy.spin_once(node, timeout_sec=0.1)
        seconds = time.perf_counter() - begin
        answer = _call(node, Trigger, "frontend/flush", Trigger.Request()).message
        node.destroy_node()
    if f"packets={len(stream)} " not in answer:
        raise SystemExit(f"of {len(stream)} packets not all came: {answer}")
    return seconds


def callbacks(stream: Stream) -> list[float]:
    """Return the milliseconds of the callback for each packet, while the worker is busy with those before."""
    node = FrontendNode()
    node.trigger_configure()
    node.trigger_activate()
    spent = []
    for data, _ in stream:
        begin = time.perf_counter()
        node._on_packet(EVENT_PACKET, data)
        spent.append(1e3 * (time.perf_counter() - begin))
        time.sleep(0.002)
    node.trigger_deactivate()
    node.destroy_node()
    return spent


def idle(seconds: float) -> dict[str, float]:
    """Return the share of a core, in %, of both nodes in each state."""
    found = {}
    with tempfile.TemporaryDirectory() as folder, NodeProcesses(Path(folder)) as processes:
        nodes = {name: processes.start(f"esfo_{name}", f"{name}_node", {}) for name in ("frontend", "backend")}
        helper = rclpy.create_node("helper")
        for state in ("active, no events", "deactivated"):
            if state == "deactivated":
                for name in nodes:
                    request = ChangeState.Request()
                    request.transition.id = DEACTIVATE
                    _call(helper, ChangeState, f"{name}/change_state", request)
            time.sleep(5.0)
            before = {name: _cpu(node) for name, node in nodes.items()}
            time.sleep(seconds)
            for name, node in nodes.items():
                found[f"{name}, {state}"] = 100 * (_cpu(node) - before[name]) / seconds
        helper.destroy_node()
    return found


def _cpu(node: NodeProcess) -> float:
    fields = Path(f"/proc/{node.pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _call(node: rclpy.node.Node, kind: type, service: str, request: object) -> object:
    client = node.create_client(kind, service)
    while not client.wait_for_service(0.5):
        pass
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future)
    node.destroy_client(client)
    return future.result()


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--events", type=float, default=8.0, help="least length of a stream, millions of events")
    parser.add_argument("--idle-s", type=float, default=20.0)
    arguments = parser.parse_args()
    print_provenance()
    rclpy.init(args=[])
    warm_up(PRESETS["default"])
    print("| stream | Mev | without ROS, Mev/s | in the graph, Mev/s | share |\n|---|---|---|---|---|")
    for name in SCENES:
        stream, events = stream_of(name, arguments.events)
        pairs = [(without_ros(stream), in_graph(stream)) for _ in range(arguments.repeats)]
        alone, graph = (events / 1e6 / np.median(column) for column in zip(*pairs, strict=True))
        share = np.median([a / b for a, b in pairs])
        print(f"| {name} | {events / 1e6:.1f} | {alone:.2f} | {graph:.2f} | {100 * share:.0f} % |", flush=True)
        latest = stream
    spent = callbacks(latest[:500])
    print(
        f"\ncallback of a packet of 4 ms: {np.median(spent):.3f} ms median, {np.quantile(spent, 0.99):.3f} ms at 99 %, "
        f"{max(spent):.2f} ms at most"
    )
    print("\n| node | CPU, % of a core |\n|---|---|")
    for name, share in idle(arguments.idle_s).items():
        print(f"| {name} | {share:.2f} |")
    rclpy.shutdown()


if __name__ == "__main__":
    main()
