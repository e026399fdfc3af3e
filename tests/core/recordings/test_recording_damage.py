"""Damaged bags: the good part with the loss counted, or one clear error; never another exception."""

from __future__ import annotations

import contextlib
import random
import shutil

import numpy as np
import pytest
from recording_bags import event_bag, everything, expect_error, packet, ros1_bag, some_events, sqlite_bag

from esfo_core.errors import EsfoError


def test_damaged_and_missing_packets_are_counted(tmp_path):
    parts = np.array_split(some_events(), 8)
    packets = [packet(part, seq) for seq, part in enumerate(parts)]
    packets[3] = packets[3][:40]
    del packets[5:7]
    recording, chunks = everything(event_bag(tmp_path / "bag.mcap", *packets))
    s = recording.statistics
    assert (s.packets, s.packets_damaged, s.packets_lost) == (5, 1, 2)
    assert (np.concatenate(chunks) == np.concatenate([parts[i] for i in (0, 1, 2, 4, 7)])).all()


@pytest.mark.parametrize("broken", [True, False])
def test_a_loss_makes_a_stateful_decoder_wait(tmp_path, broken):
    words = [[0x0003, 0x8001, 0x6001, 0x2005], [0x0004], [0x2006, 0x8001, 0x6002, 0x2007, 0x0008, 0x2009]]
    none = some_events(0)
    packets = [packet(none, i, encoding="evt3", events=np.array(w, "<u2").view("u1")) for i, w in enumerate(words)]
    packets[1:2] = [packets[1][:30]] if broken else []
    recording, chunks = everything(event_bag(tmp_path / "bag.mcap", *packets))
    assert np.concatenate(chunks)[["x", "y"]].tolist() == [(5, 3), (9, 8)]
    assert recording.statistics.decoder.unsynchronised == 2


def test_a_cut_off_mcap_gives_its_whole_part(tmp_path):
    events = some_events()
    parts = np.array_split(events, 100)
    path = event_bag(tmp_path / "bag.mcap", *(packet(part, seq) for seq, part in enumerate(parts)), chunk_size=1 << 13)
    content = path.read_bytes()
    for size in (40, 200, len(content) // 3, len(content) // 2, len(content) - 9, len(content) - 1):
        path.write_bytes(content[:size])
        if size <= 200:
            expect_error(path, "no topic of type")
            continue
        recording, chunks = everything(path)
        got = np.concatenate(chunks)
        assert (got == events[: len(got)]).all()
        lost = recording.statistics.bytes_lost
        assert 0 < lost <= (1 << 14) + len(content) // 10  # an unfinished chunk, or the index at the end
        assert 0.9 * (size - lost) < 8 * len(got) < size


@pytest.fixture(params=["mcap", "db3", "bag"])
def bag(request, tmp_path):
    """A small bag of each storage."""
    path = tmp_path / f"bag.{request.param}"
    parts = np.array_split(some_events(2000), 20)
    if request.param == "mcap":
        return event_bag(path, *(packet(part, seq) for seq, part in enumerate(parts)))
    if request.param == "db3":
        return sqlite_bag(path, parts)
    return ros1_bag(path, parts)


def test_every_storage_reads_the_same(bag):
    recording, chunks = everything(bag)
    assert (np.concatenate(chunks) == some_events(2000)).all()
    assert recording.statistics.packets == 20


def test_a_wrong_extension_is_named(bag):
    wrong = bag.with_suffix(".raw")
    shutil.copy(bag, wrong)
    expect_error(wrong, f"needs the extension {bag.suffix}")


def test_no_damage_raises_anything_else(bag):
    content = bag.read_bytes()
    rng = random.Random(5)
    for _ in range(60):
        damaged = bytearray(content)
        if rng.random() < 0.3:
            del damaged[rng.randrange(20, len(damaged)) :]
        for _ in range(rng.choice((0, 1, 5, 50))):
            damaged[rng.randrange(16, len(damaged))] = rng.randrange(256)
        bag.write_bytes(damaged)
        with contextlib.suppress(EsfoError):
            everything(bag)


@pytest.mark.parametrize("fraction", [0.95, 0.6, 0.3])
def test_a_cut_off_sqlite_bag_gives_its_whole_part(tmp_path, fraction):
    events = some_events()
    path = sqlite_bag(tmp_path / "bag.db3", np.array_split(events, 200))
    content = path.read_bytes()
    path.write_bytes(content[: int(fraction * len(content))])
    recording, chunks = everything(path)
    got = np.concatenate(chunks)
    assert set(got.tolist()) <= set(events.tolist())
    assert len(got) > 0.8 * fraction * len(events)
    assert recording.statistics.bytes_lost == len(content) - int(fraction * len(content))
    assert path.read_bytes() == content[: int(fraction * len(content))]
    path.write_bytes(content[:5000])
    expect_error(path, "cut off, and nothing can be read|damaged or unreadable|no messages|no topic of type")


@pytest.mark.parametrize("whole", [True, False])
def test_a_damaged_chunk_of_an_mcap_is_left_out(tmp_path, whole):
    events = some_events()
    parts = np.array_split(events, 100)
    path = event_bag(tmp_path / "bag.mcap", *(packet(part, seq) for seq, part in enumerate(parts)), chunk_size=1 << 13)
    content = bytearray(path.read_bytes())
    for place in (len(content) // 4, len(content) // 2):
        content[place : place + 40] = b"junk" * 10
    path.write_bytes(content if whole else content[: len(content) * 9 // 10])
    recording, chunks = everything(path)
    got = np.concatenate(chunks)
    s = recording.statistics
    assert set(got.tolist()) <= set(events.tolist())
    assert len(got) > (0.85 if whole else 0.7) * len(events)
    assert s.packets_damaged == 2
    if whole:
        assert s.packets + s.packets_damaged + s.packets_lost == 100
