"""Tables of feature tracks and their file."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_core.errors import TracksError
from esfo_core.tracks import Tracks

finite32 = st.floats(width=32, allow_nan=False, allow_infinity=False)
rows = st.tuples(
    st.integers(0, 2**32 - 1),
    st.integers(-(2**63), 2**63 - 1),
    finite32,
    finite32,
    st.floats(min_value=2.0**-149, width=32, allow_infinity=False),
)


def table(listed):
    return Tracks.from_columns(
        [r[0] for r in listed], [r[1] for r in listed], np.array([r[2:4] for r in listed]), [r[4] for r in listed]
    )


def columns(tracks):
    return [tracks.track_id.tobytes(), tracks.t.tobytes(), tracks.uv.tobytes(), tracks.sigma.tobytes()]


@pytest.fixture
def small():
    return table([(7, 10, 1.5, 2.5, 0.5), (3, 30, 0.1, -4.0, 1.0), (7, 20, 1.0, 2.0, 0.25), (3, 30, 0.1, -5.0, 1.0)])


def test_columns_are_converted_to_the_stored_types(small):
    assert [c.dtype for c in (small.track_id, small.t, small.uv, small.sigma)] == [
        np.uint32,
        np.int64,
        np.float32,
        np.float32,
    ]
    assert (len(small), small.uv.shape) == (4, (4, 2))
    assert len(Tracks.empty()) == 0
    assert Tracks.empty().uv.shape == (0, 2)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e39])
@pytest.mark.parametrize("column", [2, 3])
def test_a_position_that_is_no_number_is_named(bad, column):
    row = [1, 5, 0.0, 0.0, 1.0]
    row[column] = bad
    with pytest.raises(TracksError, match="row 1 has a non-finite position"):
        table([(1, 4, 0.0, 0.0, 1.0), row])


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf, 1e39, 1e-60])
def test_a_sigma_that_is_no_standard_deviation_is_named(bad):
    with pytest.raises(TracksError, match=r"row 1 has sigma .*not a positive number"):
        table([(1, 4, 0.0, 0.0, 1.0), (1, 5, 0.0, 0.0, bad)])


@pytest.mark.parametrize("bad", [-1, 2**32, 10**30, np.nan])
def test_ids_beyond_32_bits_are_an_error_and_never_wrap(bad):
    with pytest.raises(TracksError, match=r"track ids .* are not all of 32 bits"):
        table([(1, 4, 0.0, 0.0, 1.0), (bad, 5, 0.0, 0.0, 1.0)])


def test_times_beyond_64_bits_are_an_error():
    with pytest.raises(TracksError, match="64 bits"):
        table([(1, 2**63, 0.0, 0.0, 1.0)])


@pytest.mark.parametrize(
    "shapes",
    [
        ((2,), (3,), (3, 2), (3,)),
        ((3,), (2,), (3, 2), (3,)),
        ((3,), (3,), (2, 2), (3,)),
        ((3,), (3,), (3, 2), (2,)),
        ((3, 1), (3,), (3, 2), (3,)),
        ((3,), (3,), (3, 3), (3,)),
        ((3,), (3,), (6,), (3,)),
    ],
)
def test_columns_of_unequal_length(shapes):
    track_id, t, uv, sigma = (
        np.ones(shape, kind) for shape, kind in zip(shapes, (np.uint32, np.int64, np.float32, np.float32), strict=True)
    )
    with pytest.raises(TracksError, match="columns of unequal length"):
        Tracks(track_id, t, uv, sigma)


def test_concatenate_keeps_the_order_and_select_takes_masks_and_indices(small):
    twice = Tracks.concatenate(iter([small, Tracks.empty(), small]))
    assert columns(twice.select(np.arange(4))) == columns(small)
    assert columns(twice.select(np.arange(8) >= 4)) == columns(small)
    assert small.select(np.array([2, 0])).t.tolist() == [20, 10]
    assert len(Tracks.concatenate([])) == 0


def test_sorted_orders_by_track_then_time(small):
    ordered = small.sorted()
    assert list(zip(ordered.track_id.tolist(), ordered.t.tolist(), strict=True)) == [(3, 30), (3, 30), (7, 10), (7, 20)]
    assert ordered.uv[:, 1].tolist() == [-5.0, -4.0, 2.5, 2.0]


@settings(deadline=None)  # a busy machine is no failure
@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2), *[st.sampled_from([1.0, 2.0])] * 3)), st.randoms())
def test_sorted_is_the_same_table_whatever_order_rows_arrive_in(listed, random):
    shuffled = random.sample(listed, len(listed))
    assert columns(table(listed).sorted()) == columns(table(shuffled).sorted())


@settings(deadline=None)  # a busy machine is no failure
@given(st.lists(rows, max_size=20))
def test_csv_round_trip_is_exact_to_the_bit(tmp_path_factory, listed):
    path = tmp_path_factory.mktemp("tracks") / "tracks.csv"
    written = table(listed)
    written.write_csv(path)
    assert columns(Tracks.read_csv(path)) == columns(written)


def test_csv_round_trip_of_many_bit_patterns(tmp_path):
    bits = np.random.default_rng(5).integers(0, 2**32, (20_000, 2), dtype=np.uint32)
    uv = bits.view(np.float32)
    uv = uv[np.isfinite(uv).all(axis=1)]
    written = Tracks.from_columns(np.arange(len(uv)), np.arange(len(uv)), uv, np.full(len(uv), 0.1))
    written.write_csv(tmp_path / "tracks.csv")
    assert columns(Tracks.read_csv(tmp_path / "tracks.csv")) == columns(written)


def test_csv_as_a_spreadsheet_reads_it(small, tmp_path):
    path = tmp_path / "tracks.csv"
    small.write_csv(path)
    assert path.read_text().splitlines()[:3] == ["track_id,t,u,v,sigma", "7,10,1.5,2.5,0.5", "3,30,0.1,-4.0,1.0"]


HEADER = b"track_id,t,u,v,sigma\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "header is '', expected 'track_id,t,u,v,sigma'"),
        (b"id,t,u,v,sigma\n", "header is 'id,t,u,v,sigma'"),
        (b"x" * 100_000, "header is"),
        (HEADER + b"1,2,3,4,5\n1,2,3\n", "line 3 is not five numbers: '1,2,3'"),
        (HEADER + b"1,2,3,4,5,6\n", "line 2 is not five numbers"),
        (HEADER + b"\n1,2,3,4,5\n", "line 2 is not five numbers: ''"),
        (HEADER + b"1,2,three,4,5\n", "line 2 is not five numbers: '1,2,three,4,5'"),
        (HEADER + b"1.5,2,3,4,5\n", "line 2 is not five numbers"),
        (HEADER + b"1,2e3,3,4,5\n", "line 2 is not five numbers"),
        (HEADER + b'"1\n",2,3,"4\n\n5",5\n', "is not five numbers"),
        (HEADER + b"1," + b"9" * 5000 + b",3,4,5\n", "line 2 is not five numbers"),
        (HEADER + b"1," + b"9" * 30 + b",3,4,5\n", "64 bits"),
        (HEADER + b"-1,2,3,4,5\n", "32 bits"),
        (HEADER + b"4294967296,2,3,4,5\n", "32 bits"),
        (HEADER + b"1,2,nan,4,5\n", "row 0 has a non-finite position"),
        (HEADER + b"1,2,3,inf,5\n", "row 0 has a non-finite position"),
        (HEADER + b"1,2,3,1e39,5\n", "row 0 has a non-finite position"),
        (HEADER + b"1,2,3,4,nan\n", "row 0 has sigma nan"),
        (HEADER + b"1,2,3,4,0\n", "row 0 has sigma 0"),
        (HEADER + b"\xff\xfe\x00", "not a CSV file"),
        (HEADER + b"1,2,3,4," + b"5" * 200_000, "not a CSV file"),
        (b"\x1f\x8b\x08\x00\x00\xff\xff", "not a CSV file"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_malformed_files_end_as_one_line_with_the_path(tmp_path, content, message):
    path = tmp_path / "tracks.csv"
    path.write_bytes(content)
    with pytest.raises(TracksError, match=message) as caught:
        Tracks.read_csv(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_missing_files(tmp_path):
    with pytest.raises(TracksError, match=r"none\.csv: No such file"):
        Tracks.read_csv(tmp_path / "none.csv")
    with pytest.raises(TracksError, match="directory"):
        Tracks.read_csv(tmp_path)


def test_a_header_alone_is_an_empty_table(tmp_path):
    (tmp_path / "tracks.csv").write_bytes(HEADER)
    assert len(Tracks.read_csv(tmp_path / "tracks.csv")) == 0
