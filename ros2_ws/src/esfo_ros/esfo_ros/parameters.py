"""ROS parameters made from options."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node

from esfo_core.errors import OptionError
from esfo_core.options import OptionField, fields_of, replace

T = TypeVar("T")


def parameter_descriptor(leaf: OptionField, read_only: bool) -> ParameterDescriptor:
    """Describe an option as a parameter, with its meaning and its range or choices."""
    # Dynamic typing lets `300` stand for `300.0`, which rclpy would refuse otherwise.
    descriptor = ParameterDescriptor(
        description=leaf.meaning,
        read_only=read_only,
        dynamic_typing=True,
        additional_constraints=f"one of: {', '.join(leaf.choices)}" if leaf.choices else "",
    )
    low = -sys.float_info.max if leaf.low is None else leaf.low
    high = sys.float_info.max if leaf.high is None else leaf.high
    if leaf.low is not None or leaf.high is not None:
        if isinstance(leaf.value, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
        else:
            bounds = [round(max(min(v, 2.0**62), -(2.0**62))) for v in (low, high)]
            descriptor.integer_range = [IntegerRange(from_value=bounds[0], to_value=bounds[1], step=1)]
    return descriptor


def refuse_unknown(node: Any) -> None:
    """Raise OptionError where a parameter is set that the node does not have: a misspelt one changes nothing."""
    if not isinstance(node, Node):
        return
    unknown = [
        name
        for name in node._parameter_overrides
        if not node.has_parameter(name) and not name.startswith("qos_overrides.")
    ]
    if unknown:
        close = {name: get_close_matches(name, list(node._parameters), 1) for name in unknown}
        names = ", ".join(name + (f" (is {close[name][0]} meant?)" if close[name] else "") for name in unknown)
        raise OptionError(f"node {node.get_name()} has no parameter {names}")


def declare_fields(node: Node, options: T, read_only: bool = True) -> T:
    """Declare every field of an options dataclass as a parameter; return the options with the values that are set.

    Raises OptionError for a bad value.
    """
    return replace(options, {leaf.name: declare(node, leaf, read_only) for leaf in fields_of(options)})


def declare_options(node: Node, presets: Mapping[str, T], read_only: bool = True) -> T:
    """Declare `preset` and every field of its options; a field that is not set has the value of the preset.

    Raises OptionError for an unknown preset or a bad value.
    """
    leaf = OptionField("preset", "default", "set of default values of all options", None, None, tuple(presets))
    preset = declare(node, leaf, read_only=True)
    if preset not in presets:
        raise OptionError(f"preset is {preset!r}; choose from {', '.join(presets)}")
    return declare_fields(node, presets[preset], read_only)


def declare(node: Node, leaf: OptionField, read_only: bool) -> Any:
    """Declare one option as a parameter and return its value. Raises OptionError for a bad value."""
    try:
        value = node.declare_parameter(leaf.name, leaf.value, parameter_descriptor(leaf, read_only)).value
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        raise OptionError(f"parameter {leaf.name}: {error}") from error
    check_type(leaf, value)
    return value


def check_type(leaf: OptionField, value: object) -> None:
    """Raise OptionError when a parameter is not of the type of its option; an integer is accepted for a float."""
    allowed = (int, float) if isinstance(leaf.value, float) else (type(leaf.value),)
    if type(value) not in allowed:
        raise OptionError(f"parameter {leaf.name} takes {type(leaf.value).__name__}, got {value!r}")


def with_values(options: T, values: Mapping[str, object]) -> T:
    """Return options with the values of the parameters that are among their fields.

    Raises OptionError for a bad value.
    """
    mine = {leaf.name: leaf for leaf in fields_of(options) if leaf.name in values}
    for name, leaf in mine.items():
        check_type(leaf, values[name])
    return replace(options, {name: values[name] for name in mine})
