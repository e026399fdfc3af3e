"""Topics of a result bag: those of the nodes, with the installed definitions of their messages."""

from __future__ import annotations

import json
import re
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy

from esfo_bringup.replay.node import CLOCK, ReplayNode
from esfo_core.recordings.bag_writer import BagTopic
from esfo_frontend.ros.node import FrontendNode
from esfo_ros.topics import Topic, reliable

STREAM_TOPICS = (
    *(topic for topic in ReplayNode.OUTPUTS if topic != CLOCK),
    *FrontendNode.OUTPUTS,
    Topic("/diagnostics", DiagnosticArray, reliable(10), "state of every node"),
)
"""Topics of all nodes but the back-end; without `/clock`, which the player of a bag publishes."""

_SEPARATOR = 80 * "="
_FIELD_TYPE = re.compile(r"^\s*([A-Za-z][\w/]*)[^\s=]*\s+\w+", re.MULTILINE)
_PLAIN = re.compile(r"bool|byte|char|w?string|u?int(8|16|32|64)|float(32|64)")


def bag_topic(topic: Topic) -> BagTopic:
    """Return a node's topic as a topic of a bag, in the root namespace."""
    package = topic.kind.__module__.split(".")[0]
    kind = f"{package}/msg/{topic.kind.__name__}"
    description = json.loads(_share(kind, "json").read_text())
    hashes = {entry["type_name"]: entry["hash_string"] for entry in description["type_hashes"]}
    return BagTopic(
        name="/" + topic.name.lstrip("/"),
        kind=kind,
        definition=definition(kind),
        type_hash=hashes[kind],
        depth=topic.qos.depth,
        latched=topic.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL,
    )


def definition(kind: str) -> str:
    """Return the installed definition of a message type, then those of all types in it, in the form of rosbag2."""
    texts: dict[str, str] = {}
    wanted = [kind]
    while wanted:
        name = wanted.pop(0)
        if name not in texts:
            texts[name] = _share(name, "msg").read_text()
            wanted += _inner(texts[name], name.split("/")[0])
    first, *others = texts.items()
    return "\n".join([first[1], *(f"{_SEPARATOR}\nMSG: {n.replace('/msg/', '/')}\n{text}" for n, text in others)])


def _inner(text: str, package: str) -> list[str]:
    """Types of the fields of a definition that are themselves messages."""
    found = []
    for name in _FIELD_TYPE.findall(text):
        if not _PLAIN.fullmatch(name):
            owner, _, short = (name if "/" in name else f"{package}/{name}").rpartition("/")
            found.append(f"{owner.split('/')[0]}/msg/{short}")
    return found


def _share(kind: str, suffix: str) -> Path:
    package, _, name = kind.split("/")
    return Path(get_package_share_directory(package)) / "msg" / f"{name}.{suffix}"
