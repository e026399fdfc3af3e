"""HDF5 files of both conventions, and what may be wrong with them."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest
from recording_bags import damaged_copies, everything, expect_error, some_events

from esfo_core.errors import EsfoError
from esfo_core.recordings import ReadingOptions, hdf5

h5py = pytest.importorskip("h5py", reason="h5py, an optional package, is not installed")

TABLE = np.dtype([("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
OFFSET = 57_000_000  # us


def scene(n=300_000):
    events = some_events(n, start=OFFSET * 1000)
    events["t"] -= events["t"] % 1000
    return events


def prophesee(path, events, geometry="64x48", **options):
    table = np.empty(len(events), TABLE)
    for name in "xyp":
        table[name] = events[name]
    table["t"] = events["t"] // 1000
    with h5py.File(path, "w") as file:
        file.create_dataset("CD/events", data=table, chunks=True, **options)
        if geometry:
            file.attrs["geometry"] = geometry
    return path


def dsec(path, events, offset=OFFSET, **changes):
    columns = {name: events[name] for name in "xy"} | {"p": events["p"].astype("u1")}
    columns["t"] = (events["t"] // 1000 - (offset or 0)).astype("u4")
    with h5py.File(path, "w") as file:
        for name, values in (columns | changes).items():
            if values is not None:
                file[f"events/{name}"] = values
        if offset is not None:
            file["t_offset"] = np.int64(offset)
        file["ms_to_idx"] = np.zeros(3, "u8")
    return path


@pytest.fixture
def path(tmp_path):
    return tmp_path / "events.h5"


@pytest.mark.parametrize("write", [prophesee, dsec])
def test_round_trip(path, write):
    r, chunks = everything(write(path, scene()))
    assert (np.concatenate(chunks) == scene()).all()
    assert (r.width, r.height, r.size_inferred) == (64, 48, write is dsec)
    assert r.format == {prophesee: "HDF5, Prophesee", dsec: "HDF5, DSEC"}[write]
    assert (r.progress(), r.statistics.packets, r.statistics.decoder.out_of_range) == (1.0, 2, 0)


def test_sizes_polarities_and_offsets(path):
    events = scene(1000)
    r, chunks = everything(dsec(path, events, p=events["p"] * 2 - 1), options=ReadingOptions(width=64, height=24))
    assert (np.concatenate(chunks) == events[events["y"] < 24]).all()
    assert r.statistics.decoder.out_of_range == np.count_nonzero(events["y"] >= 24)
    events["t"] -= OFFSET * 1000
    assert (np.concatenate(everything(dsec(path, events, offset=None))[1]) == events).all()
    assert everything(prophesee(path, events, geometry=None))[0].size_inferred
    assert everything(prophesee(path, events, compression="gzip"))[0].statistics.events == 1000


ONES = np.ones(9, "u4")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"p": None}, "events has t, x, y; needed are x, y, p, t"),
        ({"p": ONES[:8]}, r"different lengths: \[9, 9, 8, 9\]"),
        ({"p": ONES * 2}, "p from 2 to 2 in events 0 to 8"),
        ({"x": ONES * 70_000}, "x from 70000 to 70000"),
        ({"y": ONES * -1.5}, "y holds numbers that are not whole, such as -1.5"),
        ({"t": ONES * np.nan}, "t from nan"),
        ({"t": np.ones((3, 3), "u4")}, "2 dimensions, not 1"),
        ({"t": np.full(9, 2**63, "u8")}, "t from"),
        ({name: ONES[:0] for name in "xypt"}, "no event tells"),
    ],
)
def test_bad_columns(path, changes, message):
    expect_error(dsec(path, scene(9), **changes), message)


def test_other_files(path, monkeypatch):
    with h5py.File(path, "w") as file:
        file["pictures"] = ONES
    expect_error(path, "without columns x, y, p, t or a table of events .it has pictures")
    with h5py.File(path, "w") as file:
        file["CD/events"] = ONES
    expect_error(path, "CD/events has the fields none")
    with h5py.File(path, "w") as file:
        file.create_dataset("CD/events", (10**12,), TABLE, chunks=(1 << 20,))
    expect_error(path, "claims 1000000000000 values and holds none")
    expect_error(prophesee(path, scene(9), geometry="large"), "the sensor size is 'large'")
    expect_error(prophesee(path, scene(9), geometry="0x480"), "0x480")
    monkeypatch.setattr(hdf5, "h5py", None)
    expect_error(path, "need h5py: pip install h5py")


def test_a_missing_filter_is_named(path):
    with h5py.File(path, "w") as file:
        properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        properties.set_chunk((100,))
        properties.set_filter(0x8ECF, h5py.h5z.FLAG_OPTIONAL)
        group = h5py.h5g.create(file.id, b"CD")
        kind, space = h5py.h5t.py_create(TABLE, logical=True), h5py.h5s.create_simple((100,))
        h5py.h5d.create(group, b"events", kind, space, properties)
    expect_error(path, "a filter that is missing here: ECF of Prophesee")


@pytest.mark.parametrize("write", [prophesee, dsec])
def test_cut_and_damaged_files(path, write):
    content = write(path, scene(3000)).read_bytes()
    for size in (9, 100, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:size])
        expect_error(path, "damaged or unreadable HDF5 file")
    for damaged in damaged_copies(content, 100, seed=3, first=8, reaches=(600, 3000)):
        path.write_bytes(damaged)
        with suppress(EsfoError):
            everything(path)
