"""What a live stream costs beyond the front-end itself, per packet and per event; prints a table of docs/benchmarks.md.

Best of several runs in CPU time of one thread, so that other work on the machine matters little.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
from provenance import print_provenance

from esfo_core.camera import SensorSize
from esfo_core.codecs import decoder, encoder
from esfo_core.events import EventArray
from esfo_core.packets import EVENT_PACKET, Packet, packet_from_cdr, sequence_of
from esfo_core.recordings import open_recording
from esfo_core.recordings.messages import header, typestore
from esfo_frontend.frontend import Frontend
from esfo_frontend.online.clock_offset import ClockOffset
from esfo_frontend.online.live_frontend import LiveFrontend
from esfo_frontend.options import PRESETS
from esfo_frontend.warm_up import warm_up

PACKET_NS = 4_000_000
OPTIONS = PRESETS["default"]


def cost(work: Callable[[], object], runs: int) -> float:
    """Return the least CPU time of one call, s."""
    times = []
    for _ in range(runs):
        begin = time.thread_time()
        work()
        times.append(time.thread_time() - begin)
    return min(times)


def messages_of(events: EventArray, size: tuple[int, int]) -> list[bytes]:
    """Serialise events as a driver sends them: `evt3`, packets of 4 ms."""
    store, encode = typestore(), encoder("evt3", round_times=True)
    edges = np.searchsorted(events["t"], np.arange(events["t"][0], events["t"][-1], PACKET_NS))
    messages = []
    for seq, (a, b) in enumerate(pairwise([*edges.tolist(), len(events)])):
        if a == b:
            continue
        time_base, data = encode(events[a:b])
        message = store.types[EVENT_PACKET](
            header=header(int(events["t"][a]), "camera"),
            width=size[0],
            height=size[1],
            seq=seq,
            time_base=time_base,
            encoding="evt3",
            is_bigendian=False,
            events=np.frombuffer(data, np.uint8),
        )
        messages.append(bytes(store.serialize_cdr(message, EVENT_PACKET)))
    return messages


def arrive(messages: list[bytes]) -> None:
    """Do what the callback does on arrival."""
    live = LiveFrontend(OPTIONS)
    for data in messages:
        live.arrived(sequence_of(EVENT_PACKET, data))


def follow_clock(messages: int) -> None:
    """Map the clock for so many packets with delays of 1 ms on average."""
    clock = ClockOffset()
    delays = np.random.default_rng(0).exponential(1e6, messages).astype(int).tolist()
    for i, delay in enumerate(delays):
        clock.update(i * PACKET_NS, i * PACKET_NS + delay)


def decoded(packets: list[Packet], size: tuple[int, int]) -> list[EventArray]:
    """Decode one packet after the other."""
    read = decoder("evt3", *size)
    return [read.decode(p.data, p.time_base) for p in packets]


def live(messages: list[bytes]) -> None:
    """Take in the whole stream as the worker does."""
    stream = LiveFrontend(OPTIONS)
    for data in messages:
        for _ in stream.process(packet_from_cdr(EVENT_PACKET, data)):
            pass
    list(stream.flush())


def alone(parts: list[EventArray], size: tuple[int, int]) -> None:
    """Run the front-end on the same events, decoded before."""
    frontend = Frontend(SensorSize(*size), OPTIONS)
    for part in parts:
        frontend.process(part)
    frontend.flush()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path, help="any recording, of which the events are taken")
    parser.add_argument("--runs", type=int, default=5)
    arguments = parser.parse_args()
    print_provenance()
    recording = open_recording(arguments.recording)
    events = np.concatenate(list(recording.chunks()))
    size = (recording.width, recording.height)
    messages = messages_of(events, size)
    packets = [packet_from_cdr(EVENT_PACKET, data) for data in messages]
    parts = decoded(packets, size)
    warm_up(OPTIONS)
    store, n, runs = typestore(), len(messages), arguments.runs
    steps = {
        "on arrival: sequence number, losses": cost(lambda: arrive(messages), runs),
        "raw message to packet": cost(lambda: [packet_from_cdr(EVENT_PACKET, data) for data in messages], runs),
        "the same by rosbags": cost(lambda: [store.deserialize_cdr(data, EVENT_PACKET) for data in messages], runs),
        "clock offset": cost(lambda: follow_clock(n), runs),
        "decoding": cost(lambda: decoded(packets, size), runs),
    }
    print(f"{len(events) / 1e6:.2f} M events in {n} packets of {PACKET_NS / 1e6:.0f} ms\n")
    print("| step | us per packet |\n|---|---|")
    for name, seconds in steps.items():
        print(f"| {name} | {1e6 * seconds / n:.1f} |")
    # In turn, so that both have the same machine.
    pairs = [(cost(lambda: live(messages), 1), cost(lambda: alone(parts, size), 1)) for _ in range(runs)]
    whole, frontend = np.min(pairs, axis=0)
    print(f"| all of the worker | {1e6 * whole / n:.1f} |")
    print(f"| front-end alone, events decoded before | {1e6 * frontend / n:.1f} |")
    print(f"\nlive / front-end alone, CPU: {whole / frontend:.3f}")
    print(f"live: {len(events) / whole / 1e6:.2f} Mev per CPU second")


if __name__ == "__main__":
    main()
