"""docs/interfaces.md lists every parameter, topic and service that the code has: its tables are made by this test.

`python tests/test_interfaces_doc.py` writes them anew.
"""

import re
from pathlib import Path

import pytest

pytest.importorskip("esfo_msgs.msg", reason="the messages are not built: make setup")

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

import esfo_backend.options
import esfo_backend.ros.live_backend
import esfo_frontend.online.live_frontend
import esfo_frontend.options
from esfo_backend.ros.node import BackendNode
from esfo_bringup.camera_info.node import CameraInfoNode
from esfo_bringup.camera_info.options import CameraInfoOptions
from esfo_bringup.replay.node import ReplayNode
from esfo_bringup.replay.player import ReplayOptions
from esfo_bringup.settings import common_options
from esfo_core.options import fields_of
from esfo_frontend.ros.node import FrontendNode
from esfo_simulation.handheld.scene import HandheldOptions
from esfo_simulation.scene import SceneOptions

ROOT = Path(__file__).parents[1]
DOCUMENT = ROOT / "docs/interfaces.md"
PACKAGES = ROOT / "ros2_ws/src"
NODES = {"frontend": FrontendNode, "backend": BackendNode, "replay": ReplayNode, "camera_info": CameraInfoNode}


def common_table():
    """Lines of a table of the parameters that users change most, with the node that has each."""
    lines = ["| parameter | node | default | meaning |", "|---|---|---|---|"]
    frontend = {leaf.name for leaf in fields_of(esfo_frontend.options.FrontendOptions())}
    for leaf in common_options():
        node = "frontend" if leaf.name in frontend else "backend"
        choices = f" ({', '.join(leaf.choices)})" if leaf.choices else ""
        lines.append(f"| `{leaf.name}` | {node} | {leaf.value}{choices} | {leaf.meaning} |")
    return lines


def parameter_table(default, paper):
    """Lines of a table of all fields of an options dataclass, with the value of the paper where it differs.

    The parameters that users change most come first.
    """
    lines = ["| parameter | default | paper | range | meaning |", "|---|---|---|---|---|"]
    other = {} if paper is None else {leaf.name: leaf.value for leaf in fields_of(paper)}
    for leaf in sorted(fields_of(default), key=lambda leaf: not leaf.common):
        allowed = ", ".join(leaf.choices)
        if leaf.low is not None or leaf.high is not None:
            low, high = ("" if v is None else f"{v:g}" for v in (leaf.low, leaf.high))
            allowed = f"{low} .. {high}"
        changed = other.get(leaf.name, leaf.value)
        paper_value = "" if changed == leaf.value else f"{changed}"
        lines.append(f"| `{leaf.name}` | {leaf.value} | {paper_value} | {allowed} | {leaf.meaning} |")
    return lines


def type_name(kind):
    return f"{kind.__module__.split('.')[0]}/{kind.__name__}"


def quality(qos):
    """One profile in words."""
    reliability = "reliable" if qos.reliability == ReliabilityPolicy.RELIABLE else "best effort"
    durability = ", latched" if qos.durability == DurabilityPolicy.TRANSIENT_LOCAL else ""
    return f"{reliability}{durability}, keep last {qos.depth}"


def topic_table():
    """Lines of a table of the topics of all nodes: what is published first."""
    lines = ["| topic | type | node | QoS | contents |", "|---|---|---|---|---|"]
    for way in ("OUTPUTS", "INPUTS"):
        for name, node in NODES.items():
            for topic in getattr(node, way, ()):
                at = f"{name} ->" if way == "OUTPUTS" else f"-> {name}"
                kind = f"`{type_name(topic.kind)}`"
                lines.append(f"| `{topic.name}` | {kind} | {at} | {quality(topic.qos)} | {topic.meaning} |")
    return lines


def service_table():
    """Lines of a table of the services of all nodes."""
    lines = ["| service | type | does |", "|---|---|---|"]
    for name, node in NODES.items():
        for service in getattr(node, "SERVICES", ()):
            full = service.name.replace("~", name)
            when = "; after all that is on the way" if service.after_quiet else ""
            lines.append(f"| `{full}` (`{service.name}`) | `std_srvs/Trigger` | {service.meaning}{when} |")
    return lines


def tables():
    """All generated tables by the name of their place in the document."""
    frontend, backend = esfo_frontend.options.PRESETS, esfo_backend.options.PRESETS
    return {
        "topics": topic_table(),
        "services": service_table(),
        "common": common_table(),
        "frontend": parameter_table(frontend["default"], frontend["paper"]),
        "frontend node": parameter_table(esfo_frontend.online.live_frontend.FrontendNodeOptions(), None),
        "backend": parameter_table(backend["default"], backend["paper"]),
        "backend node": parameter_table(esfo_backend.ros.live_backend.BackendNodeOptions(), None),
        "replay": parameter_table(ReplayOptions(), None),
        "camera_info": parameter_table(CameraInfoOptions(), None),
        "simulate": parameter_table(SceneOptions(), None),
        "simulate --handheld": parameter_table(HandheldOptions(), None),
    }


def with_tables(text):
    """Put every table between its two marks."""
    for name, lines in tables().items():
        marked = rf"(<!-- {name} -->\n).*?(<!-- end -->)"
        assert re.search(marked, text, re.S), f"no place for the table {name!r}"
        body = "\n".join(lines) + "\n"
        text = re.sub(marked, lambda m, body=body: m[1] + body + m[2], text, count=1, flags=re.S)
    return text


def test_parameters_are_those_of_the_code():
    text = DOCUMENT.read_text()
    assert text == with_tables(text)


def test_parameters_that_users_change_come_first():
    names = [re.match(r"\| `(.+?)`", line)[1] for line in tables()["backend"][2:]]
    common = [leaf.name for leaf in common_options()]
    assert 5 <= len(common) <= 10, common
    assert names[: len(set(common) & set(names))] == [name for name in common if name in names]
    assert set(names) == {leaf.name for leaf in fields_of(esfo_backend.options.BackendOptions())}


def test_no_node_has_a_topic_or_service_that_is_not_in_its_list():
    for path in PACKAGES.glob("*/esfo_*/**/node.py"):
        calls = re.findall(r"create_\w*(?:publisher|subscription|service)\(\s*([^)]*)", path.read_text())
        literal = [call for call in calls if re.search(r"[\"'][~/\w]+[\"']", call)]
        # The base of the nodes and the listener of a live run, which is no part of the graph that users see.
        allowed = {"lifecycle": ["Diagnostic"], "live": ["FeatureTracks", "EventActivity", "OrbitEstimate", "Point"]}
        others = [call for call in literal if not call.startswith(tuple(allowed.get(path.parent.name, ())))]
        assert not others, f"{path}: {others}"
    assert sum(len(node.OUTPUTS) for node in NODES.values()) > 10


if __name__ == "__main__":
    DOCUMENT.write_text(with_tables(DOCUMENT.read_text()))
