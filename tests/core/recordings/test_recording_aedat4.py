"""AEDAT4 files, written by hand from the definition of the container, and damaged ones."""

from __future__ import annotations

import struct
from contextlib import suppress

import lz4.frame
import numpy as np
import pytest
from backports import zstd
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_bags import damaged_copies, everything, expect_error, some_events
from recording_truth import recording

from esfo_core.codecs.aedat4 import Aedat4Decoder
from esfo_core.errors import EsfoError, RecordingError
from esfo_core.recordings import aedat4
from esfo_core.recordings.flatbuffer import RootTable

START = 1_700_000_000_000_000_000
COMPRESSIONS = {"none": (0, bytes), "LZ4": (1, lz4.frame.compress), "Zstandard": (3, zstd.compress)}
STREAM = "<node name='{}'><attr key='typeIdentifier'>{}</attr><node name='info'>{}</node></node>"
SIZE = "<attr key='sizeX'>64</attr><attr key='sizeY'>48</attr>"


def info(*streams):
    return ("<dv version='2.0'><node name='outInfo'>" + "".join(streams) + "</node></dv>").encode()


INFO = info(STREAM.format(0, "EVTS", SIZE), STREAM.format(1, "FRME", SIZE))


def table(kind, fields):
    """A buffer of one table: fields as (form, value), or bytes for a vector with its length in front."""
    entries, body, tail = [], b"", b""
    size = 4 + sum(4 if isinstance(f, bytes) else struct.calcsize("<" + f[0]) for f in fields)
    for field in fields:
        entries.append(4 + len(body))
        if isinstance(field, bytes):
            body += struct.pack("<I", size - 4 - len(body) + len(tail))
            tail += field
        else:
            body += struct.pack("<" + field[0], field[1])
    vtable = struct.pack(f"<HH{len(entries)}H", 4 + 2 * len(entries), size, *entries)
    content = struct.pack("<I", 8 + len(vtable)) + kind + vtable + struct.pack("<i", len(vtable)) + body + tail
    return struct.pack("<I", len(content)) + content


def words(events):
    data = np.zeros(len(events), Aedat4Decoder.word)
    data["t"], data["x"], data["y"], data["on"] = events["t"] // 1000, events["x"], events["y"], events["p"]
    return data.tobytes()


def packet(events):
    return table(b"EVTS", [struct.pack("<I", len(events)) + words(events)])


def container(packets, compression="LZ4", xml=INFO, ends=True):
    """A whole file; packets as (stream, content before compression)."""
    number, compress = COMPRESSIONS[compression]
    body = b"".join(struct.pack("<ii", s, len(compress(c))) + compress(c) for s, c in packets)
    text = struct.pack("<I", len(xml)) + xml
    size = 14 + len(table(b"IOHE", [("i", number), ("q", 0), text]))
    position = size + len(body) if ends else -1
    header = table(b"IOHE", [("i", number), ("q", position), text])
    return b"#!AER-DAT4.0\r\n" + header + body + (compress(b"some table") if ends else b"")


def parts(n=8):
    events = some_events(4000, start=START)
    events["t"] -= events["t"] % 1000
    return np.array_split(events, n)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "events.aedat4"


@pytest.mark.parametrize("ends", [True, False])
@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_round_trip(path, compression, ends):
    packets = [(0, packet(part)) for part in parts()]
    packets[3:3] = [(1, b"a picture"), (0, table(b"EVTS", []))]
    path.write_bytes(container(packets, compression, ends=ends))
    r, chunks = everything(path)
    assert (np.concatenate(chunks) == np.concatenate(parts())).all()
    assert (r.format, r.width, r.height, r.progress()) == (f"AEDAT4, {compression}", 64, 48, 1.0)
    s = r.statistics
    assert (s.packets, s.packets_damaged, s.bytes_lost, s.decoder.out_of_range) == (9, 0, 0, 0)


def test_damaged_packets_are_counted(path):
    packets = [(0, packet(part)) for part in parts()]
    packets[2] = (0, packets[2][1][:-1])
    packets[4] = (0, b"EVTS" * 9)
    packets[5] = (0, packets[5][1].replace(b"EVTS", b"FRME"))
    path.write_bytes(container(packets))
    r, chunks = everything(path)
    assert (np.concatenate(chunks) == np.concatenate([parts()[i] for i in (0, 1, 3, 6, 7)])).all()
    assert (r.statistics.packets, r.statistics.packets_damaged) == (5, 3)


@pytest.mark.parametrize("ends", [True, False])
def test_a_cut_file_gives_its_whole_packets(path, ends):
    content = container([(0, packet(part)) for part in parts()], "none", ends=ends)
    size = 8 + len(packet(parts()[0]))
    start = len(content) - 8 * size - (10 if ends else 0)
    for cut in (start + size + 3, start + 3 * size + 9, start + 5 * size - 1):
        path.write_bytes(content[:cut])
        r, chunks = everything(path)
        assert len(np.concatenate(chunks)) == 500 * ((cut - start) // size)
        assert r.statistics.bytes_lost >= (cut - start) % size > 0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"#!AER-DAT3.1\r\n# cAER", "AEDAT of version 3.1 is not read"),
        (b"#!AER-DAT4.0\r\n", "header of 0 bytes is longer"),
        (b"#!AER-DAT4.0\r\n" + b"\xff" * 20, "header of 4294967295 bytes is longer than the file"),
        (b"#!AER-DAT4.0\r\n" + struct.pack("<I", 40) + bytes(40), "kind .* where 'IOHE' belongs"),
        (container([], xml=b"<dv>"), "list of streams is damaged"),
        (container([], xml=info()), "no event stream; event streams: none"),
        (container([], xml=info(STREAM.format(0, "EVTS", ""))), "sensor size '' x ''"),
        (container([], xml=info(STREAM.format("a", "EVTS", SIZE))), "'a' has no number"),
        (container([], xml=info(*(STREAM.format(i, "EVTS", SIZE) for i in (0, 5)))), "choose one of 0, 5"),
        (container([]), "no events in 0 packets"),
        (container([(0, packet(parts()[0][::-1].copy()))], xml=INFO.replace(b"64", b"0")), "0x48"),
    ],
)
def test_bad_files(path, content, message):
    path.write_bytes(content)
    expect_error(path, message)


def test_the_stream_is_chosen_by_its_number(path):
    xml = info(*(STREAM.format(i, "EVTS", SIZE) for i in (0, 5)))
    path.write_bytes(container([(0, packet(parts()[0])), (5, packet(parts()[1][:7]))], xml=xml))
    assert everything(path, topic="5")[0].statistics.events == 7
    expect_error(path, "no event stream '3'; event streams: 0, 5", topic="3")


@pytest.mark.parametrize("compression", ["LZ4", "Zstandard"])
def test_gigantic_packets_take_no_memory(path, compression, monkeypatch):
    monkeypatch.setattr(aedat4, "LARGEST_PACKET", 1 << 20)
    packets = [(0, packet(parts()[0])), (0, packet(parts()[1]) + bytes(1 << 20)), (0, packet(parts()[2]))]
    path.write_bytes(container(packets, compression, ends=False) + struct.pack("<ii", 0, 2**31 - 1))
    r, _ = everything(path)
    assert (r.statistics.packets, r.statistics.packets_damaged, r.statistics.bytes_lost) == (2, 1, 8)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_no_damage_raises_anything_else(path, compression):
    content = container([(0, packet(part)) for part in parts()], compression)
    for damaged in damaged_copies(content, 150, seed=11, first=14, reaches=(60, 600)):
        path.write_bytes(damaged)
        with suppress(EsfoError):
            everything(path)


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=80), st.integers(0, 5))
def test_random_tables_raise_nothing_else(data, field):
    with suppress(RecordingError):
        root = RootTable(data[:8] + b"EVTS" + data[8:], "EVTS")
        assert isinstance(root.number(field, "<q", -1), int)
        assert len(root.vector(field, 16)) <= len(data)


event = st.tuples(st.integers(0, 40_000), st.integers(0, 70), st.integers(0, 70), st.integers(0, 2))


@settings(max_examples=100, deadline=None)
@given(st.lists(st.lists(event, max_size=20), max_size=4))
def test_decoder_equals_plain_python(packets):
    d, outside = Aedat4Decoder(64, 48), 0
    for rows in packets:
        data = b"".join(struct.pack("<qHHB3x", *row) for row in rows)
        inside = [(x, y, int(on > 0), t * 1000) for t, x, y, on in rows if x < 64 and y < 48]
        outside += len(rows) - len(inside)
        assert [e.item() for e in d.decode(data)] == sorted(inside, key=lambda e: e[3])
    assert d.statistics.out_of_range == outside
    for t in (-1, 2**62 // 1000 + 1):
        with pytest.raises(RecordingError, match="out of the range"):
            d.decode(struct.pack("<qHHB3x", t, 0, 0, 0))


@pytest.mark.parametrize(
    ("name", "counts", "duration", "box"),
    [
        ("raw/davis346.aedat4", (37_573, 41_257), 2.359945, (0, 345, 2, 259)),
        ("wheel/wheel_11_34_19.aedat4", (61_632, 75_545), 3.445661, (123, 222, 80, 179)),
        ("wheel/wheel_11_34_58.aedat4", (81_913, 83_405), 1.828915, (123, 222, 80, 179)),
        ("wheel/wheel_11_36_31.aedat4", (61_051, 99_937), 1.635539, (123, 222, 80, 179)),
    ],
)
def test_real_files(name, counts, duration, box):
    r, chunks = everything(recording(name))
    e = np.concatenate(chunks)
    assert (r.format, r.width, r.height) == ("AEDAT4, LZ4", 346, 260)
    assert tuple(np.bincount(e["p"])) == counts
    assert (e["t"][-1] - e["t"][0]) / 1e9 == pytest.approx(duration, abs=1e-9)
    assert (e["x"].min(), e["x"].max(), e["y"].min(), e["y"].max()) == box
    assert (r.statistics.packets_damaged, r.statistics.bytes_lost, r.statistics.decoder.out_of_range) == (0, 0, 0)
