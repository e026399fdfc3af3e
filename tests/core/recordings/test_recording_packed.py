"""Recordings of every format, compressed as a whole, in archives, or message by message."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import os
import tarfile
import threading
import zipfile
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
from backports import zstd
from recording_bags import EVENT_PACKET, event_bag, everything, expect_error, packet, ros1_bag, some_events, write_bag

EVENTS = some_events(4000)
EVENTS["t"] -= EVENTS["t"] % 1000
PARTS = np.array_split(EVENTS, 7)
PACKERS = {
    ".gz": gzip.compress,
    ".zst": zstd.compress,
    ".zstd": zstd.compress,
    ".lz4": lz4.frame.compress,
    ".bz2": bz2.compress,
    ".xz": lzma.compress,
}


def zipped(name, content):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("README.md", b"made by a test")
        archive.writestr(f"deep/{name}", content)
    return out.getvalue()


def tarred(name, content):
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w:gz") as archive:
        for path, data in (("calib.txt", b"1 2 3 4"), (f"deep/{name}", content)):
            entry = tarfile.TarInfo(path)
            entry.size = len(data)
            archive.addfile(entry, io.BytesIO(data))
    return out.getvalue()


def plain(folder, kind):
    """A file of the kind that holds EVENTS."""
    if kind == "mcap":
        return event_bag(folder / "a.mcap", *(packet(part, k) for k, part in enumerate(PARTS)))
    if kind == "bag":
        return ros1_bag(folder / "a.bag", PARTS)
    path = folder / f"a.{kind}"
    if kind == "npy":
        np.save(path, EVENTS)
        return path
    t, x, y, p = ((EVENTS[name] // (1000 if name == "t" else 1)).astype("<u4") for name in "txyp")
    words = np.stack([0x8 << 28 | t >> 6, p << 28 | (t & 63) << 22 | x << 11 | y], axis=1).astype("<u4")
    path.write_bytes(b"% evt 2.0\n% geometry 64x48\n% end\n" + words.tobytes())
    return path


@pytest.mark.parametrize("end", [*PACKERS, ".zip", ".tar.gz", ".tgz"])
@pytest.mark.parametrize("kind", ["mcap", "bag", "npy", "raw"])
def test_any_format_in_any_package(tmp_path, kind, end):
    path = plain(tmp_path, kind)
    content = path.read_bytes()
    pack = {".zip": zipped, ".tar.gz": tarred, ".tgz": tarred}.get(end, lambda _, data: PACKERS[end](data))
    for name in (f"{path.name}{end}", f"no_name{end}"):
        target = tmp_path / name
        target.write_bytes(pack(path.name, content))
        recording, chunks = everything(target)
        assert (np.concatenate(chunks) == EVENTS).all()
        assert recording.named_path == target
        folder = Path(recording.unpacked_to[0].name)
        assert folder.exists()
        del recording
        assert not folder.exists()


def test_an_archive_of_two_recordings_names_them(tmp_path):
    path = tmp_path / "two.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.raw", b"1")
        archive.writestr("b.raw", b"2")
    expect_error(path, "the archive needs one recording; it has a.raw, b.raw")


@pytest.mark.parametrize("end", PACKERS)
def test_damaged_packages(tmp_path, end):
    packed = PACKERS[end](plain(tmp_path, "raw").read_bytes())
    path = tmp_path / f"a.raw{end}"
    path.write_bytes(packed[:20] + b"junkjunkjunk" * 30 + packed[380:])
    expect_error(path, "damaged or unreadable compressed file")


@pytest.mark.parametrize("end", [".zstd", ".zst"])
def test_bags_compressed_by_file(tmp_path, end):
    plain_folder, folder = tmp_path / "plain", tmp_path / "bag"
    plain_folder.mkdir()
    folder.mkdir()
    for k, part in enumerate(np.array_split(EVENTS, 12)):
        content = event_bag(plain_folder / f"r_{k}.mcap", packet(part, k)).read_bytes()
        (folder / f"r_{k}.mcap{end}").write_bytes(zstd.compress(content))
    recording, chunks = everything(folder)
    assert (np.concatenate(chunks) == EVENTS).all()
    assert recording.statistics.packets_lost == 0
    names = "".join(f"    - r_{k}.mcap{end}\n" for k in range(12))
    (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  relative_file_paths:\n{names}")
    assert (np.concatenate(everything(folder)[1]) == EVENTS).all()


def test_bags_compressed_by_message(tmp_path):
    messages = [("/events", EVENT_PACKET, zstd.compress(bytes(packet(part, k)))) for k, part in enumerate(PARTS)]
    recording, chunks = everything(write_bag(tmp_path / "a.mcap", messages))
    assert (np.concatenate(chunks) == EVENTS).all()
    assert recording.statistics.packets_damaged == 0


@pytest.mark.parametrize("kind", ["mcap", "raw", "npy"])
@pytest.mark.parametrize("pack", [bytes, gzip.compress])
def test_a_pipe_is_read(tmp_path, kind, pack):
    content = pack(plain(tmp_path, kind).read_bytes())
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(content,))
    writer.start()
    recording, chunks = everything(pipe)
    writer.join()
    assert (np.concatenate(chunks) == EVENTS).all()
    assert recording.named_path == pipe


def test_a_device_is_refused():
    expect_error(Path("/dev/null"), "is neither a file, nor a folder, nor a pipe")
