"""Events in the columns of NumPy files and of HDF5 files of many layouts."""

from __future__ import annotations

import numpy as np
import pytest
from recording_bags import everything, expect_error, some_events

from esfo_core.recordings import ReadingOptions

EVENTS = some_events(3000, start=2_000_000_000, seconds=1.5)
EVENTS["t"] -= EVENTS["t"] % 1000
UNITS = {"us": (1000, "<i8"), "ns": (1, "<i8"), "s": (10**9, "<f8")}


def columns(unit="us", names="xypt", polarity=lambda p: p):
    divisor, kind = UNITS[unit]
    t = (EVENTS["t"] / divisor if kind == "<f8" else EVENTS["t"] // divisor).astype(kind)
    values = {"x": EVENTS["x"], "y": EVENTS["y"], "p": polarity(EVENTS["p"]), "t": t}
    return dict(zip(names.split() if " " in names else names, (values[name] for name in "xypt"), strict=True))


def table(order, unit="us"):
    found = columns(unit)
    return np.stack([found[name].astype(np.float64 if unit == "s" else np.int64) for name in order], axis=1)


def structured(names="xypt", unit="us"):
    found = columns(unit, names)
    kinds = [(name, values.dtype) for name, values in found.items()]
    array = np.empty(len(EVENTS), kinds)
    for name, values in found.items():
        array[name] = values
    return array


def check(path, **options):
    recording, chunks = everything(path, options=ReadingOptions(**options))
    assert (np.concatenate(chunks) == EVENTS).all()
    assert (recording.width, recording.height, recording.statistics.outliers) == (64, 48, 0)
    return recording


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("order", ["xypt", "txyp", "xytp"])
def test_numpy_tables(tmp_path, unit, order):
    np.save(tmp_path / "e.npy", table(order, unit))
    recording = check(tmp_path / "e.npy")
    assert recording.guesses == (f"columns {','.join(order)} (option columns)", f"time in {unit} (option time_unit)")
    np.savez(tmp_path / "e.npz", events=table(order, unit))
    check(tmp_path / "e.npz", columns=",".join(order), time_unit=unit)


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("names", ["x y p t", "x y polarity timestamp", "xs ys ps ts"])
def test_numpy_columns_by_name(tmp_path, unit, names):
    np.save(tmp_path / "e.npy", structured(names, unit))
    check(tmp_path / "e.npy")
    np.savez_compressed(tmp_path / "e.npz", **columns(unit, names, polarity=lambda p: p.astype(bool)))
    check(tmp_path / "e.npz")
    np.savez(tmp_path / "f.npz", events=structured(names, unit), other=np.zeros(3))
    check(tmp_path / "f.npz")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"a": np.zeros(3)}, "without columns x, y, p, t or one table of them .it has a float64"),
        (columns() | {"x": EVENTS["x"][:5]}, "different lengths"),
        (columns() | {"p": EVENTS["p"] * 3}, "p from 0 to 3 in events"),
        (columns() | {"x": EVENTS["x"] + 0.5}, "x holds numbers that are not whole"),
        (columns() | {"t": -EVENTS["t"]}, "t from"),
        (columns() | {"x": np.array(["a"] * len(EVENTS))}, "x holds values of type"),
        (columns() | {"p": np.zeros((2, 2))}, "p has 2 dimensions"),
        ({"e": np.zeros((5, 4)), "f": np.zeros((5, 4))}, "or one table of them"),
        ({"e": np.array([{}], object)}, "damaged or unreadable NumPy file"),
    ],
)
def test_numpy_files_that_hold_no_events(tmp_path, content, message):
    np.savez(tmp_path / "e.npz", **content)
    expect_error(tmp_path / "e.npz", message)


def test_a_cut_numpy_file(tmp_path):
    path = tmp_path / "e.npy"
    np.save(path, structured())
    path.write_bytes(path.read_bytes()[:5000])
    expect_error(path, "damaged or unreadable NumPy file")


def test_stray_pixels_of_columns_are_dropped(tmp_path):
    found = columns()
    found["x"] = found["x"].astype(np.int64)
    found["x"][[3, 900]] = -1, 10**6
    np.savez(tmp_path / "e.npz", **found)
    recording, chunks = everything(tmp_path / "e.npz")
    assert (np.concatenate(chunks) == np.delete(EVENTS, [3, 900])).all()
    assert (recording.width, recording.height, recording.statistics.decoder.out_of_range) == (64, 48, 2)


def hdf5_file(path, **content):
    h5py = pytest.importorskip("h5py", reason="h5py, an optional package, is not installed")
    with h5py.File(path, "w") as file:
        for name, values in content.items():
            file[name.replace("__", "/")] = values
    return path


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("group", ["events__{}", "prophesee__left__{}", "{}", "davis__right__events__{}"])
@pytest.mark.parametrize("names", ["x y p t", "xs ys ps ts"])
def test_hdf5_columns_in_any_group(tmp_path, unit, group, names):
    content = {group.format(name): values for name, values in columns(unit, names).items()}
    check(hdf5_file(tmp_path / "e.h5", **content, ms_map_idx=np.zeros(4), calib__K=np.eye(3)))


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("order", ["xytp", "txyp", "xypt"])
@pytest.mark.parametrize("name", ["davis__left__events", "events"])
def test_hdf5_tables(tmp_path, unit, order, name):
    check(hdf5_file(tmp_path / "e.h5", **{name: table(order, unit)}, davis__left__imu=np.zeros((4, 6))))


@pytest.mark.parametrize("offset", [np.int64(1000), np.array([1000]), np.array([[1000.0]])])
def test_hdf5_offsets(tmp_path, offset):
    found = columns()
    found["t"] = (found["t"] - 1000).astype("u4")
    check(hdf5_file(tmp_path / "e.h5", **{f"events__{k}": v for k, v in found.items()}, t_offset=offset))
    content = {f"events__{k}": v for k, v in found.items()}
    expect_error(hdf5_file(tmp_path / "e.h5", **content, t_offset=np.zeros(2)), "t_offset is .*, not one number")


def test_hdf5_with_two_cameras(tmp_path):
    both = {f"prophesee__{side}__{name}": v for side in ("left", "right") for name, v in columns().items()}
    path = hdf5_file(tmp_path / "e.h5", **both)
    expect_error(path, "events in several places, choose one of prophesee/left, prophesee/right")
    recording, chunks = everything(path, topic="/prophesee/right")
    assert (np.concatenate(chunks) == EVENTS).all()
    assert recording.format == "HDF5, prophesee/right"
    expect_error(path, "no events in 'up'; events are in: prophesee/left, prophesee/right", topic="up")
