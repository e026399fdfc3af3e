"""Texts without names, units or sizes: what fits their numbers is taken, told, and can be overridden."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from recording_bags import everything, expect_error, some_events

from esfo_core.errors import RecordingError
from esfo_core.recordings import ReadingOptions
from esfo_core.recordings.extent import Extent

EVENTS = some_events(3000, start=5_000_000_000, seconds=2.0)
EVENTS["t"] -= EVENTS["t"] % 1000
DIVISOR = {"us": 1000, "ns": 1}


def as_text(order, separator=" ", unit="us", events=EVENTS, polarity=("0", "1"), quote=""):
    columns = {
        "x": events["x"].astype(str),
        "y": events["y"].astype(str),
        "p": np.array(polarity)[events["p"]],
        "t": (events["t"] // DIVISOR[unit]).astype(str),
    }
    rows = zip(*(columns[name] for name in order), strict=True)
    return "".join(separator.join(f"{quote}{field}{quote}" for field in row) + "\n" for row in rows)


def read(tmp_path, text, **options):
    path = tmp_path / "events.txt"
    path.write_bytes(text.encode())
    recording, chunks = everything(path, options=ReadingOptions(**options))
    return recording, np.concatenate(chunks)


@pytest.mark.parametrize("separator", [" ", ",", "\t", "; "])
@pytest.mark.parametrize("order", ["xypt", "txyp", "xytp", "tpxy", "pxyt"])
def test_orders_of_columns(tmp_path, order, separator):
    recording, events = read(tmp_path, as_text(order, separator))
    assert (events == EVENTS).all()
    assert recording.guesses == (f"columns {','.join(order)} (option columns)", "time in us (option time_unit)")


@pytest.mark.parametrize("order", ["xypt", "txyp", "xytp"])
def test_times_that_could_be_pixels(tmp_path, order):
    events = some_events(3000, seconds=0.012)  # up to 12,000 us
    events["t"] -= events["t"] % 1000
    recording, found = read(tmp_path, as_text(order, events=events))
    assert (found == events).all()
    assert (recording.width, recording.height) == (64, 48)


@pytest.mark.parametrize("order", ["".join(order) for order in permutations("xypt")][::5])
def test_what_is_told_counts(tmp_path, order):
    recording, events = read(tmp_path, as_text(order, unit="ns"), columns=",".join(order), time_unit="ns")
    assert (events == EVENTS).all()
    assert recording.guesses == ()


@pytest.mark.parametrize("start", [0, 1_700_000_000 * 10**9])
@pytest.mark.parametrize("unit", ["us", "ns"])
def test_units(tmp_path, start, unit):
    events = EVENTS.copy()
    events["t"] += start
    recording, found = read(tmp_path, as_text("xypt", ",", unit, events))
    assert (found == events).all()
    assert recording.guesses[1] == f"time in {unit} (option time_unit)"


def test_a_time_beyond_all_clocks_is_refused(tmp_path):
    (tmp_path / "e.csv").write_text("1,2,1,9000000000000000000\n" * 200)
    expect_error(tmp_path / "e.csv", "a time of 9000000000000000000 comes after the year 2100 in every unit")


@pytest.mark.parametrize("polarity", [("0", "1"), ("-1", "1"), ("False", "True"), ("off", "on"), ("false", "TRUE")])
@pytest.mark.parametrize("quote", ["", '"'])
def test_polarities_and_quotes(tmp_path, polarity, quote):
    text = as_text("txyp", ",", polarity=polarity, quote=quote)
    for start in ("", "\ufeff", "timestamp,x,y,polarity\n", "A camera\nof a vendor, in a lab\nt,x,y,p\n"):
        _, events = read(tmp_path, start + text.replace("\n", "\r\n"))
        assert (events == EVENTS).all()


@pytest.mark.parametrize("line", ["%geometry:64,48", "% geometry 64x48", "# geometry=64,48", "64 48"])
def test_a_size_before_the_events(tmp_path, line):
    recording, events = read(tmp_path, f"% made by a decoder\n{line}\n" + as_text("xypt", ","))
    assert (events == EVENTS).all()
    assert (recording.width, recording.height, recording.size_inferred) == (64, 48, False)


def test_lines_that_are_no_events_are_skipped_and_told_while_they_are_few(tmp_path):
    lines = as_text("xypt", ",").splitlines()
    for k in (0, 700, 2999):
        lines[k] = lines[k].replace(",", ";;", 1)[:-9] + "junk"
    recording, events = read(tmp_path, "\n".join(lines) + "\n")
    assert (events == np.delete(EVENTS, [0, 700, 2999])).all()
    assert recording.statistics.decoder.bad_lines == 2
    assert "line 701: " in recording.statistics.first_fault
    assert recording.guesses[-1].startswith("1 lines before the events hold none")
    path = tmp_path / "more.csv"
    path.write_text("\n".join(line + ",1" * (k % 20 == 19) for k, line in enumerate(lines)))
    expect_error(path, "line 20: 5 fields, not 4")


@pytest.mark.parametrize("stray", [(65534, 20), (20, 60_000), (500, 400), (200, 5)])
def test_stray_pixels_do_not_make_the_sensor(tmp_path, stray):
    events = EVENTS.copy()
    events["x"][[40, 2000]], events["y"][[40, 2000]] = stray
    recording, found = read(tmp_path, as_text("txyp", events=events))
    assert (recording.width, recording.height, recording.size_inferred) == (64, 48, True)
    assert (found == np.delete(events, [40, 2000])).all()
    assert recording.statistics.decoder.out_of_range == 2


def test_pixels_at_the_border_do():
    extent = Extent()
    rng = np.random.default_rng(0)
    extent.add(rng.integers(40, 90, 10_000), rng.integers(0, 90, 10_000))
    extent.add(np.array([150]), np.array([99]))
    assert extent.size() == (151, 100)


@pytest.mark.parametrize("pixels", [(range(0, 12_000, 7), [50]), (range(100), [3]), ([], [])])
def test_no_sensor_has_such_a_size(pixels):
    extent = Extent()
    extent.add(*(np.array(values, np.int64) for values in pixels))
    with pytest.raises(RecordingError, match=r"which none has|no event tells"):
        extent.size()
