"""Text files: their layouts, compression and sizes, and what may be wrong with them."""

from __future__ import annotations

import gzip
import random
import zipfile
from contextlib import suppress

import numpy as np
import pytest
from backports import zstd
from recording_bags import damaged_copies, everything, expect_error, some_events
from recording_truth import recording

from esfo_core.errors import EsfoError, OptionError
from esfo_core.recordings import ReadingOptions, open_recording

LINES = ((5, 6, 1, 1_000_000), (7, 8, 0, 2_000_500))  # x, y, p, t in us
SIZE = ReadingOptions(width=64, height=48)


def read(path, content, **options):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    r, chunks = everything(path, options=ReadingOptions(**options))
    return r, [tuple(int(v) for v in row) for row in np.concatenate(chunks)]


@pytest.mark.parametrize(
    ("content", "form"),
    [
        ("5,6,1,1000000\n7,8,0,2000500\n", "x,y,p,t in us"),
        ("5,6,1,1000000\n7,8,-1,2000500", "x,y,p,t in us"),
        ("1000000,5,6,1\n2000500,7,8,0\n", "t,x,y,p in us"),
        ("1.0 5 6 1\n2.0005 7 8 0\n", "t,x,y,p in s"),
        ("# made by hand\r\n\r\n1.0\t5\t6\t1\r\n2.0005\t7\t8\t0\r\n", "t,x,y,p in s"),
        ("64 48\n1.0 5 6 1\n2.0005 7 8 -1\n", "t,x,y,p in s"),
        ("x,y,p,t\n5,6,1,1000000\n7,8,0,2000500\n", "x,y,p,t in us"),
        ("\ufefft_ms,polarity,row,col\n1000,1,6,5\n2000.5,0,8,7\n", "t,p,y,x in ms"),
        ("t [µs] x [px] y [px] pol\n1000000 5 6 1\n2000500 7 8 0\n", "t,x,y,p in us"),
        ("id;timestamp(ns);x;y;p\n9;1000000000;5;6;1\nab;2000500000;7;8;0\n", "id,t,x,y,p in ns"),
        ("1.0e+00 5.0e+00 6.0e+00 1.0e+00\n2.0005e+00 7.0e+00 8.0e+00 0.0e+00\n", "t,x,y,p in s"),
    ],
)
def test_layouts(tmp_path, content, form):
    r, rows = read(tmp_path / "events.csv", content)
    assert rows == [(x, y, p, t * 1000) for x, y, p, t in LINES]
    assert r.format == f"text, {form}"
    size_told = content.startswith("64 48")
    assert (r.width, r.height, r.size_inferred) == ((64, 48, False) if size_told else (8, 9, True))
    assert (r.camera, r.progress(), r.statistics.bytes_lost) == (None, 1.0, 0)


def test_what_the_user_tells_comes_first(tmp_path):
    path = tmp_path / "events.txt"
    r, rows = read(path, "1 6 5 1000\n0 8 7 2000.0\n", columns="p, y, x, t", time_unit="ms", width=7, height=20)
    assert rows == [(5, 6, 1, 10**9)]
    assert (r.width, r.height, r.size_inferred, r.statistics.decoder.out_of_range) == (7, 20, False, 1)
    with pytest.raises(OptionError, match="64x0 px: give both"):
        open_recording(path, options=ReadingOptions(width=64, columns="p,y,x,t", time_unit="ms"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("just text, nothing more\n", "starts with 'just text"),
        ("one line\nanother line\n1 2 3 4\n", "no order of columns fits"),
        ("a,b,c,d\n1,2,1,4\n", "'a,b,c,d' does not name x, y, p and t"),
        ("x,y,p,t\n", "without a line of events"),
        ("x,y,p,t\n1,2,1,4,5\n", "has 5 columns, not x,y,p,t"),
        ("1 2 3 4 5\n", "5 columns without names"),
        ("1 2 3 4\n", "no order of columns fits"),
        ("1.0 2 3 1\n2.0 2 3 1\n", "leave their unit open"),
        ("1,2,1,1\n1,2,0,2\n1,2,-1,3\n", "line 3: p is 0 and -1 for off"),  # 0 and -1: no knowing
        ("# 1\nx,y,p,t\n1,2,1,1\n\n1,2,junk,2\n", "line 5: p is 'junk', not 0, 1, -1, true or false: '1,2,junk,2'"),
        ("1,2,1,1\n1,-2,1,2\n", "line 2: y is '-2', not a whole number from 0 to 65535"),
        ("1,2,1,1\n1,2,1\n", "line 2: 3 fields, not 4: '1,2,1' .read as x,y,p,t with time in us; the options"),
        ("1,2,1,1\n" + 5000 * "7", "line 2 is longer than 4096 bytes"),
    ],
)
def test_bad_text(tmp_path, content, message):
    path = tmp_path / "events.txt"
    path.write_text(content)
    expect_error(path, message)


def as_csv(events):
    lines = [f"{x},{y},{p},{t // 1000}" for x, y, p, t in events.tolist()]
    return "\n".join(["x,y,p,t", *lines, ""]).encode()


def zipped(path, files):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


@pytest.fixture(params=["csv", "gz", "zip", "zst"])
def packed(request, tmp_path):
    """A text of 200,000 events, more than two blocks, in each kind of file."""
    events = some_events(200_000)
    events["t"] -= events["t"] % 1000
    content = as_csv(events)
    path = tmp_path / f"events.{request.param}"
    if request.param == "zip":
        zipped(path, {"images/": b"", "calib.txt": b"1 2 3", "deep/events.txt": content})
    else:
        path.write_bytes({"csv": bytes, "gz": gzip.compress, "zst": zstd.compress}[request.param](content))
    return path, events


def test_compressed_files_read_the_same(packed):
    path, events = packed
    r, chunks = everything(path, options=SIZE)
    assert (np.concatenate(chunks) == events).all()
    assert (r.progress(), r.statistics.bytes_lost) == (1.0, 0)


def test_cut_files_give_their_whole_part(packed):
    path, events = packed
    content = path.read_bytes()
    for size in (len(content) * 2 // 3, len(content) - 5):
        path.write_bytes(content[:size])
        if path.suffix == ".zip":  # its table of contents is at the end
            expect_error(path, "damaged or unreadable compressed file", options=SIZE)
            continue
        r, chunks = everything(path, options=SIZE)
        got = np.concatenate(chunks)
        assert (got == events[: len(got)]).all()
        assert len(got) > 0.5 * len(events) * size / len(content)
        assert r.statistics.bytes_lost > 0


def test_no_damage_raises_anything_else(packed):
    path, _ = packed
    for damaged in damaged_copies(path.read_bytes(), 12, seed=7, first=4):
        path.write_bytes(damaged)
        with suppress(EsfoError):
            everything(path, options=SIZE)


def test_archives_and_empty_files(tmp_path):
    path = tmp_path / "events.zip"
    expect_error(zipped(path, {"a.csv": b"", "b.csv": b""}), "it has a.csv, b.csv")
    expect_error(zipped(path, {"a.png": b""}), "it has none")
    expect_error(zipped(path, {"a.csv": b""}), "the compressed file is empty")
    assert everything(zipped(path, {"a.csv": as_csv(some_events(50)), "a.png": b""}))[0].statistics.events == 50
    (tmp_path / "events.gz").write_bytes(gzip.compress(random.Random(2).randbytes(9000)))
    expect_error(tmp_path / "events.gz", "no known form|without a line of events")


@pytest.mark.parametrize(
    ("name", "count", "first", "last"),
    [
        ("shapes", 20_000, (162, 27, 0, 2_097_134_001), (127, 147, 1, 2_195_729_000)),
        ("poster", 30_000, None, (93, 110, 0, 660_948_999)),
        ("boxes", 30_000, None, (42, 145, 1, 13_595_874_999)),
    ],
)
def test_event_camera_dataset(name, count, first, last):
    path = recording(f"event_camera_dataset/{name}_rotation/events.txt")
    r, chunks = everything(path, options=ReadingOptions(width=240, height=180))
    events = np.concatenate(chunks)
    assert (r.format, len(events), r.statistics.bytes_lost) == ("text, t,x,y,p in s", count, 0)
    assert first in (None, events[0].item())
    assert events[-1].item() == last
    assert r.statistics.decoder.out_of_range == 0
