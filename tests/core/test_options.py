"""Options: dotted names, conversion from text, ranges and choices."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esfo_core.errors import OptionError
from esfo_core.options import OptionField, check, common_fields, fields_of, option, parse_assignments, replace


@dataclasses.dataclass(frozen=True)
class Inner:
    window_s: float = option(0.03, "length of a window in s", 1e-3, 1.0)
    free: float = option(1.0, "any number", common=True)


@dataclasses.dataclass(frozen=True)
class Stage:
    count: int = option(10, "number of things", 1, 100)
    enabled: bool = option(True, "whether it is done")
    inner: Inner = dataclasses.field(default_factory=Inner)


@dataclasses.dataclass(frozen=True)
class Pipeline:
    mode: str = option("fast", "how it is done", choices=("fast", "slow"))
    note: str = option("", "free text")
    stage: Stage = dataclasses.field(default_factory=Stage)


DEFAULT = Pipeline()


def value_of(options, name):
    return {leaf.name: leaf.value for leaf in fields_of(options)}[name]


def test_leaves_are_listed_in_order_with_all_that_was_declared():
    leaves = fields_of(DEFAULT)
    assert [leaf.name for leaf in leaves] == [
        "mode",
        "note",
        "stage.count",
        "stage.enabled",
        "stage.inner.window_s",
        "stage.inner.free",
    ]
    assert leaves[4] == OptionField("stage.inner.window_s", 0.03, "length of a window in s", 1e-3, 1.0, ())
    assert leaves[0].choices == ("fast", "slow")


def test_common_options_are_those_marked():
    assert [leaf.name for leaf in common_fields(DEFAULT)] == ["stage.inner.free"]
    assert not any(leaf.common for leaf in fields_of(DEFAULT) if leaf.name != "stage.inner.free")


def test_replace_sets_nested_names_and_leaves_the_rest():
    changed = replace(DEFAULT, {"stage.inner.window_s": "0.5", "stage.count": "7", "mode": "slow"})
    assert changed == Pipeline("slow", "", Stage(7, True, Inner(0.5)))
    assert Pipeline() == DEFAULT
    assert replace(DEFAULT, {}) == DEFAULT


@pytest.mark.parametrize(
    ("name", "given_value", "expected"),
    [
        ("stage.count", "12", 12),
        ("stage.count", 12.0, 12),
        ("stage.count", np.int64(12), 12),
        ("stage.inner.window_s", "2e-2", 0.02),
        ("stage.inner.window_s", 1, 1.0),
        ("stage.inner.free", "-7", -7.0),
        ("stage.enabled", "false", False),
        ("stage.enabled", "FALSE", False),
        ("stage.enabled", "True", True),
        ("stage.enabled", False, False),
        ("stage.enabled", np.False_, False),
        ("note", "a:=b", "a:=b"),
    ],
)
def test_values_take_the_type_of_the_default(name, given_value, expected):
    found = value_of(replace(DEFAULT, {name: given_value}), name)
    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize(
    ("name", "bad", "message"),
    [
        ("stage.count", "many", "stage.count takes a value of type int, got 'many'"),
        ("stage.count", "3.7", "stage.count takes a value of type int, got '3.7'"),
        ("stage.count", 3.7, "stage.count takes a whole number, got 3.7"),
        ("stage.count", None, "stage.count takes a value of type int, got None"),
        ("stage.count", float("inf"), "stage.count takes a whole number, got inf"),
        ("stage.count", "0", "stage.count is 0, below 1"),
        ("stage.count", 101, "stage.count is 101, above 100"),
        ("stage.inner.window_s", "wide", "takes a value of type float"),
        ("stage.inner.window_s", [1.0], "takes a value of type float"),
        ("stage.inner.window_s", 10**400, "takes a value of type float"),
        ("stage.inner.window_s", "0", "stage.inner.window_s is 0.0, below 0.001"),
        ("stage.inner.window_s", "1.0000001", "above 1.0"),
        ("stage.inner.window_s", "nan", "stage.inner.window_s is nan, not a finite number"),
        ("stage.inner.free", "nan", "stage.inner.free is nan, not a finite number"),
        ("stage.inner.free", "-inf", "stage.inner.free is -inf, not a finite number"),
        ("stage.enabled", "yes", "stage.enabled takes true or false, got 'yes'"),
        ("stage.enabled", "", "stage.enabled takes true or false, got ''"),
        ("stage.enabled", 1, "stage.enabled takes true or false, got 1"),
        ("stage.enabled", None, "stage.enabled takes true or false, got None"),
        ("stage.enabled", float("nan"), "stage.enabled takes true or false, got nan"),
        ("mode", "faster", "mode is 'faster'; choose from fast, slow"),
        ("mode", None, "mode is 'None'; choose from fast, slow"),
        ("stage.cuont", "1", "unknown option 'stage.cuont'; known: mode, note, stage.count"),
        ("stage", "1", "unknown option 'stage'"),
        ("count", "1", "unknown option 'count'"),
        ("stage.inner.window_s.x", "1", "unknown option"),
        ("", "1", "unknown option ''"),
    ],
)
def test_bad_values_and_names_are_named(name, bad, message):
    with pytest.raises(OptionError) as caught:
        replace(DEFAULT, {name: bad})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("edge", [1, 100])
def test_ranges_are_closed(edge):
    assert replace(DEFAULT, {"stage.count": edge}).stage.count == edge


@settings(deadline=None)  # a busy machine is no failure
@given(st.floats())
def test_no_number_outside_its_range_passes(value):
    if 1e-3 <= value <= 1.0:
        assert replace(DEFAULT, {"stage.inner.window_s": repr(value)}).stage.inner.window_s == value
    else:
        with pytest.raises(OptionError):
            replace(DEFAULT, {"stage.inner.window_s": repr(value)})


@pytest.mark.parametrize("bad", [Inner(float("nan")), Inner(-1.0), Inner(2.0), Inner(0.5, float("inf"))])
def test_check_finds_what_was_set_in_code(bad):
    check(DEFAULT)
    with pytest.raises(OptionError, match=r"stage\.inner\."):
        check(Pipeline(stage=Stage(inner=bad)))


def test_a_whole_number_in_code_leaves_a_float_option_a_float():
    in_code = Pipeline(stage=Stage(inner=Inner(window_s=1)))
    assert type(value_of(in_code, "stage.inner.window_s")) is float
    assert replace(in_code, {"stage.inner.window_s": "0.25"}).stage.inner.window_s == 0.25


def test_assignments_are_split_at_the_first_sign():
    texts = ["stage.count:=3", "note:=a:=b", "note:=", "stage.count:=4"]
    assert parse_assignments(texts) == {"stage.count": "4", "note": ""}
    assert parse_assignments(["note:=a:=b"]) == {"note": "a:=b"}
    assert parse_assignments([]) == {}


@pytest.mark.parametrize("text", ["stage.count=3", "stage.count", ":=3", "", "stage.count:3"])
def test_other_forms_of_assignment_are_errors(text):
    with pytest.raises(OptionError, match=r"is not of the form name:=value") as caught:
        parse_assignments([text])
    assert repr(text) in str(caught.value)
