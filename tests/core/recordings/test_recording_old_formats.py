"""AEDAT 2.0 and Event Stream files, written by hand from their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from recording_bags import everything, expect_error, some_events

from esfo_core.recordings import ReadingOptions

EVENTS = some_events(3000, start=2**32 * 1000 - 200_000_000)  # the 32 bits of AEDAT 2.0 wrap on the way
EVENTS["t"] -= EVENTS["t"] % 1000


def aedat2(path, chip, size, events=EVENTS):
    """As jAER writes it: columns from the right, rows from the bottom."""
    x, y = size[0] - 1 - events["x"].astype("u8"), size[1] - 1 - events["y"].astype("u8")
    p, t = events["p"].astype("u8"), events["t"] // 1000 % 2**32
    if "DVS128" in chip or "Tmp" in chip:
        address, other = x << 1 | y << 8 | (1 - p), 1 << 15
    else:
        address, other = y << 22 | x << 12 | p << 11, 1 << 31 | 77
    words = np.stack([address, t], axis=1).astype(">u4")
    words = np.insert(words, [5, 900], [[other, int(t[0])]], axis=0)  # a trigger or a sample of a frame
    header = f"#!AER-DAT2.0\r\n# This is a raw AE data file\r\n# AEChip: eu.jaer.{chip}\r\n# End of Preferences\r\n"
    path.write_bytes(header.encode() + words.tobytes())
    return path


@pytest.mark.parametrize(
    ("chip", "size"),
    [
        ("retina.DVS128", (128, 128)),
        ("chip.davis.DAVIS240C", (240, 180)),
        ("chip.davis.DAVIS240B", (240, 180)),
        ("chip.davis.Davis346blue", (346, 260)),
        ("DavisRed_346x260.DAVIS_346", (346, 260)),
    ],
)
def test_aedat2(tmp_path, chip, size):
    recording, chunks = everything(aedat2(tmp_path / "a.aedat", chip, size))
    assert (np.concatenate(chunks) == EVENTS).all()
    assert (recording.width, recording.height, recording.size_inferred) == (*size, False)
    assert recording.statistics.outliers == 0


def test_aedat2_of_an_unknown_chip(tmp_path):
    path = aedat2(tmp_path / "a.aedat", "Custom", (300, 200))
    expect_error(path, "names no chip of dvs128.* say the sensor size by the options width and height")
    _, chunks = everything(path, options=ReadingOptions(width=300, height=200))
    assert (np.concatenate(chunks) == EVENTS).all()
    path.write_bytes(b"#!AER-DAT3.1\r\n")
    expect_error(path, "AEDAT of version 3.1 is not read, only 2.0 and 4.0")


def test_aedat2_with_a_damaged_time(tmp_path):
    path = aedat2(tmp_path / "a.aedat", "DAVIS240C", (240, 180))
    content = bytearray(path.read_bytes())
    content[-8 * 1000 + 4] ^= 0x40
    path.write_bytes(content)
    recording, chunks = everything(path)
    assert (np.concatenate(chunks) == np.delete(EVENTS, 2000)).all()
    assert recording.statistics.outliers == 1


def event_stream(path, events, kind=1, version=2):
    data = bytearray(b"Event Stream" + bytes([version, 0, 0, kind, 64, 0, 48, 0]))
    before = 0
    for x, y, p, t in events.tolist():
        step, before = t // 1000 - before, t // 1000
        data += b"\xff" * (step // 127) + b"\xfe" * (x == 7)
        row = 47 - y
        data += bytes([step % 127 << 1 | p, x & 255, x >> 8, row & 255, row >> 8])
    path.write_bytes(data)
    return path


def test_event_stream(tmp_path):
    events = some_events(3000)
    events["t"] -= events["t"] % 1000
    recording, chunks = everything(event_stream(tmp_path / "a.es", events))
    assert (np.concatenate(chunks) == events).all()
    assert (recording.width, recording.height, recording.format) == (64, 48, "Event Stream, DVS")
    expect_error(event_stream(tmp_path / "a.es", events, kind=2), "kind 2; only DVS events")
    expect_error(event_stream(tmp_path / "a.es", events, version=1), "version 1.0.0; only version 2")
    (tmp_path / "a.es").write_bytes(b"Event Stream\2")
    expect_error(tmp_path / "a.es", "ends in its header")
