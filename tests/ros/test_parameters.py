"""ROS parameters: every option, with its meaning and range, and nothing that can be set wrongly in silence."""

import pytest

pytest.importorskip("esfo_msgs.msg", reason="the messages are not built: make setup")

import rclpy
from rclpy.parameter import Parameter

from esfo_core.errors import OptionError
from esfo_core.options import fields_of
from esfo_frontend.options import PRESETS
from esfo_ros.parameters import declare_options


@pytest.fixture
def node_with(ros_domain):
    context, nodes = rclpy.Context(), []
    rclpy.init(context=context, domain_id=ros_domain)

    def make(**overrides):
        values = [Parameter(name.replace("__", "."), value=value) for name, value in overrides.items()]
        nodes.append(rclpy.create_node("some", context=context, parameter_overrides=values))
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()
    context.shutdown()


@pytest.mark.parametrize("read_only", [True, False])
def test_every_option_is_a_parameter_with_meaning_and_range(node_with, read_only):
    node = node_with()
    assert declare_options(node, PRESETS, read_only) == PRESETS["default"]
    for leaf in fields_of(PRESETS["default"]):
        assert node.get_parameter(leaf.name).value == leaf.value
        descriptor = node.describe_parameter(leaf.name)
        assert descriptor.description == leaf.meaning
        assert descriptor.read_only == read_only
        for bounds in (descriptor.floating_point_range, descriptor.integer_range):
            assert not bounds or (bounds[0].from_value == leaf.low and bounds[0].to_value == leaf.high)
        assert len(descriptor.floating_point_range) + len(descriptor.integer_range) == (leaf.low is not None)


def test_a_preset_and_single_values_on_top(node_with):
    options = declare_options(node_with(preset="paper", density__radius=6), PRESETS)
    assert options.join == PRESETS["paper"].join != PRESETS["default"].join
    assert options.density.radius == 6.0
    assert isinstance(options.density.radius, float)


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        ({"preset": "best"}, "preset is 'best'; choose from default, paper"),
        ({"density__radius": 1000.0}, "density.radius"),
        ({"density__radius": 1000}, "density.radius"),
        ({"density__radius": "wide"}, "density.radius takes float, got 'wide'"),
        ({"clusters__min_size": 9.5}, "clusters.min_size takes int, got 9.5"),
        ({"clusters__min_size": True}, "clusters.min_size takes int, got True"),
    ],
)
def test_bad_values_are_refused_by_name(node_with, overrides, says):
    with pytest.raises(OptionError, match=says):
        declare_options(node_with(**overrides), PRESETS)
