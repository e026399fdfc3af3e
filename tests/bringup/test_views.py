"""RViz and Foxglove show topics that exist, with types and QoS that fit; neither program runs here."""

import json
import re
from pathlib import Path

import pytest
import yaml

pytest.importorskip("esfo_msgs.msg", reason="the messages are not built: make setup")

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from esfo_backend.ros.messages import POINT_DTYPE
from esfo_backend.ros.node import BackendNode
from esfo_bringup.replay.node import ReplayNode
from esfo_frontend.ros.node import FrontendNode
from esfo_ros.topics import mismatch

BRINGUP = Path(__file__).parents[2] / "ros2_ws/src/esfo_bringup"
HEALTH = "diagnostics"  # published by the base of the nodes, in no list of theirs
PUBLISHED = {t.name.lstrip("/"): t for node in (FrontendNode, BackendNode, ReplayNode) for t in node.OUTPUTS}
PANELS = {"3D": {"PointCloud2", "MarkerArray", "TFMessage"}, "Image": {"Image"}}
FRAMES = {"camera", "object"}


def rviz():
    return yaml.safe_load((BRINGUP / "rviz/esfo.rviz").read_text())["Visualization Manager"]


def displays_with_topics():
    return [display for display in rviz()["Displays"] if "Topic" in display]


@pytest.mark.parametrize("display", displays_with_topics(), ids=lambda display: display["Name"])
def test_rviz_subscribes_to_what_is_published(display):
    topic = PUBLISHED[display["Topic"]["Value"]]  # relative, so that a namespace holds
    assert display["Class"].rpartition("/")[2] == topic.kind.__name__
    words = {
        name: display["Topic"][f"{name} Policy"].replace(" ", "_").upper() for name in ("Reliability", "Durability")
    }
    asked = QoSProfile(
        depth=display["Topic"]["Depth"],
        reliability=ReliabilityPolicy[words["Reliability"]],
        durability=DurabilityPolicy[words["Durability"]],
    )
    assert mismatch(topic.qos, asked) == ""
    assert asked.durability == topic.qos.durability, "who comes late sees what is latched"


def test_rviz_looks_from_the_camera():
    settings = rviz()
    assert settings["Global Options"]["Fixed Frame"] == "camera"
    assert settings["Views"]["Current"]["Target Frame"] == "<Fixed Frame>"
    kinds = {display["Class"].rpartition("/")[2] for display in settings["Displays"]}
    assert kinds >= {"TF", "PointCloud2", "MarkerArray", "Image"}


def layout():
    return json.loads((BRINGUP / "foxglove/esfo.json").read_text())


def leaves(node):
    """Panels of a tree of splits."""
    if isinstance(node, str):
        return [node]
    assert set(node) == {"direction", "first", "second", "splitPercentage"}
    assert node["direction"] in ("row", "column")
    return leaves(node["first"]) + leaves(node["second"])


def test_foxglove_places_every_panel_once():
    whole = layout()
    assert set(whole) == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    assert sorted(leaves(whole["layout"])) == sorted(whole["configById"])


def paths(panel, config):
    """Message paths that a panel shows."""
    if panel == "3D":
        return list(config["topics"])
    if panel == "Image":
        return [config["imageMode"]["imageTopic"]]
    if panel == "Plot":
        return [series["value"] for series in config["paths"]]
    return [config["topicPath"] if panel == "RawMessages" else config["topicToRender"]]


def test_foxglove_shows_what_is_published():
    shown = set()
    for name, config in layout()["configById"].items():
        panel = name.partition("!")[0]
        for path in paths(panel, config):
            match = re.fullmatch(r"/(\w+)(?:\.(\w+))?", path)
            assert match, f"{name}: {path}"
            topic, field = match.groups()
            shown.add(topic)
            if topic == HEALTH:
                assert panel.startswith("Diagnostic")
                continue
            kind = PUBLISHED[topic].kind
            assert kind.__name__ in PANELS.get(panel, {kind.__name__}), f"{name} cannot show {kind.__name__}"
            fields = kind.get_fields_and_field_types()
            if panel == "Plot":
                assert fields[field] == "double", f"{name}: {path}"
                assert "header" in fields  # of which the plot takes the time
    assert shown >= {"points", "markers", "overlay", "orbit", HEALTH}


def test_foxglove_colours_points_by_a_field_they_have():
    scene = layout()["configById"]["3D!scene"]
    assert scene["topics"]["/points"]["colorField"] in POINT_DTYPE.names
    names = {display["Channel Name"] for display in rviz()["Displays"] if "Channel Name" in display}
    assert names <= set(POINT_DTYPE.names)
    assert scene["followTf"] == "camera"
    assert {frame.removeprefix("frame:") for frame in scene["transforms"]} == FRAMES
