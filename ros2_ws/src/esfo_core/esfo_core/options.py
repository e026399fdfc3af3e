"""Options: every stage owns a frozen dataclass; names on the command line and in ROS are `stage.field`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from esfo_core.errors import OptionError

T = TypeVar("T")


def option(
    default: Any,
    meaning: str,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    common: bool = False,
) -> Any:
    """Declare a field with its default, one line of meaning (with the unit) and its closed range or choices.

    common: the option is one of the few that users change; documents and `--help` list these first.
    """
    return dataclasses.field(
        default=default,
        metadata={"meaning": meaning, "low": low, "high": high, "choices": choices, "common": common},
    )


@dataclasses.dataclass(frozen=True)
class OptionField:
    """One leaf of an options tree: dotted name, default, meaning, range, choices, whether users often change it."""

    name: str
    value: bool | int | float | str
    meaning: str
    low: float | None
    high: float | None
    choices: tuple[str, ...]
    common: bool = False


def fields_of(options: Any, prefix: str = "") -> list[OptionField]:
    """List the leaves of a (nested) options dataclass in declaration order."""
    found: list[OptionField] = []
    for field in dataclasses.fields(options):
        value = getattr(options, field.name)
        if dataclasses.is_dataclass(value):
            found += fields_of(value, f"{prefix}{field.name}.")
        else:
            if isinstance(field.default, float) and isinstance(value, int):
                value = float(value)  # `1` set in code where 1.0 is meant must not make it an option of whole numbers
            found.append(OptionField(f"{prefix}{field.name}", value, **field.metadata))
    return found


def common_fields(options: Any) -> list[OptionField]:
    """List the leaves of a (nested) options dataclass that are marked as common, in declaration order."""
    return [leaf for leaf in fields_of(options) if leaf.common]


def check(options: Any) -> None:
    """Raise OptionError for the first value outside its range or choices, or that is not a finite number."""
    for leaf in fields_of(options):
        if leaf.choices and leaf.value not in leaf.choices:
            raise OptionError(f"{leaf.name} is {leaf.value!r}; choose from {', '.join(leaf.choices)}")
        if isinstance(leaf.value, str):
            continue
        if not math.isfinite(leaf.value):
            raise OptionError(f"{leaf.name} is {leaf.value}, not a finite number")
        if leaf.low is not None and not leaf.value >= leaf.low:
            raise OptionError(f"{leaf.name} is {leaf.value}, below {leaf.low}")
        if leaf.high is not None and not leaf.value <= leaf.high:
            raise OptionError(f"{leaf.name} is {leaf.value}, above {leaf.high}")


def replace(options: T, values: Mapping[str, object]) -> T:
    """Return a copy with the dotted names in `values` set, converted to the type of the default.

    Raises OptionError for an unknown name, a value of another type or one outside its range.
    """
    known = {leaf.name: leaf.value for leaf in fields_of(options)}
    result = options
    for name, value in values.items():
        if name not in known:
            raise OptionError(f"unknown option {name!r}; known: {', '.join(known)}")
        result = _set(result, name.split("."), _convert(name, value, type(known[name])))
    check(result)
    return result


def parse_assignments(texts: Iterable[str]) -> dict[str, str]:
    """Split `name:=value` texts, the form of ROS arguments. Raises OptionError for any other form."""
    values: dict[str, str] = {}
    for text in texts:
        name, separator, value = text.partition(":=")
        if not separator or not name:
            raise OptionError(f"{text!r} is not of the form name:=value")
        values[name] = value
    return values


def _convert(name: str, value: object, kind: type) -> object:
    if kind is bool:
        if str(value).lower() not in ("true", "false"):
            raise OptionError(f"{name} takes true or false, got {value!r}")
        return str(value).lower() == "true"
    if kind is int and isinstance(value, float) and not value.is_integer():
        raise OptionError(f"{name} takes a whole number, got {value!r}")
    try:
        return kind(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise OptionError(f"{name} takes a value of type {kind.__name__}, got {value!r}") from error


def _set(options: Any, path: list[str], value: object) -> Any:
    if len(path) == 1:
        return dataclasses.replace(options, **{path[0]: value})
    return dataclasses.replace(options, **{path[0]: _set(getattr(options, path[0]), path[1:], value)})
