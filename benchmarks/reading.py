"""How fast each form of recording is read: prints the table of docs/benchmarks.md."""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from provenance import print_provenance
from reading_files import Case, all_cases, large_file
from tqdm import tqdm

from esfo_core.codecs import decoder
from esfo_core.errors import EsfoError
from esfo_core.events import EventArray
from esfo_core.recordings import open_recording


def speed(read: Callable[[], Iterable[EventArray]]) -> float:
    """Mev per CPU second, the best of three after a first time that compiles."""
    best = 0.0
    for trial in range(4):
        begin = time.process_time()
        count = sum(len(events) for events in read())
        seconds = time.process_time() - begin
        best = max(best, count / seconds / 1e6) if trial else 0.0
    return best


def decoding(case: Case) -> Iterator[EventArray]:
    """Decode the packets in memory."""
    events_of = decoder(case.encoding, *case.size)
    return (events_of.decode(data, time_base) for time_base, data in case.packets)


def table(count: int) -> None:
    """Print the table of all forms."""
    with tempfile.TemporaryDirectory() as folder:
        cases = all_cases(Path(folder), count)
        print("| form | decoded alone, Mev/s | of mono | whole `chunks()`, Mev/s | of mono | bytes per event |")
        print("|---|---|---|---|---|---|")
        reference: tuple[float, float] | None = None
        for case in tqdm(cases, desc="reading", disable=None, leave=False):
            reference = line(case, reference)
    print(f"\nPeak memory of the whole run: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


def line(case: Case, reference: tuple[float, float] | None) -> tuple[float, float] | None:
    """Print one row; return the speeds of the first one, to which the others are compared."""
    try:
        recording = open_recording(case.path)
        whole = speed(recording.chunks)
    except EsfoError as error:
        print(f"| {case.name} | | | not read: {error} | | |")
        return reference
    alone = speed(lambda: decoding(case)) if case.packets else 0.0
    first = reference or (alone, whole)
    parts = (f"{alone:.1f}", f"{alone / first[0]:.2f}") if alone else ("", "")
    size = recording.size_bytes / recording.statistics.events
    print(f"| {case.name} | {parts[0]} | {parts[1]} | {whole:.1f} | {whole / first[1]:.2f} | {size:.1f} |")
    return first


def resident() -> int:
    """Memory of this process that is in use, MiB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() >> 20


def large(gigabytes: float) -> None:
    """Print how memory grows while long recordings are read."""
    print("| file | size | events | Mev per CPU s | memory in use after 10 % | at most after that | at the end |")
    print("|---|---|---|---|---|---|---|")
    for name in ("long.mcap", "long.raw"):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / name
            expected = large_file(path, gigabytes)
            recording, use = open_recording(path), []
            begin = time.process_time()
            for _ in tqdm(recording.chunks(), desc=name, disable=None, leave=False):
                use.append(resident())
            seconds = time.process_time() - begin
            assert recording.statistics.events == expected
            tenth = use[len(use) // 10]
            print(
                f"| {recording.format} | {path.stat().st_size / 1e9:.2f} GB | {expected / 1e6:.0f} M | "
                f"{expected / seconds / 1e6:.1f} | {tenth} MiB | {max(use[len(use) // 10 :])} MiB | {use[-1]} MiB |"
            )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--events", type=int, default=4_000_000, help="events per form (default %(default)s)")
    parser.add_argument(
        "--large",
        type=float,
        default=0.0,
        metavar="GB",
        help="read files of this size instead, made in a temporary folder",
    )
    args = parser.parse_args()
    print_provenance()
    if args.large:
        large(args.large)
    else:
        table(args.events)


if __name__ == "__main__":
    main()
