"""docs/interfaces.md lists every parameter and topic that the code has: its tables are made by this test.

`python tests/test_interfaces_doc.py` writes them anew.
"""

import re
from pathlib import Path

import esfo_backend.live
import esfo_backend.options
import esfo_frontend.live
import esfo_frontend.options
from esfo_bringup.replay.player import ReplayOptions
from esfo_core.options import fields_of
from esfo_core.simulation.handheld.scene import HandheldOptions
from esfo_core.simulation.scene import SceneOptions

ROOT = Path(__file__).parents[1]
DOCUMENT = ROOT / "docs/interfaces.md"
PACKAGES = ROOT / "ros2_ws/src"


def parameter_table(default, paper):
    """Lines of a table of all fields of an options dataclass, with the value of the paper where it differs."""
    lines = ["| parameter | default | paper | range | meaning |", "|---|---|---|---|---|"]
    other = {} if paper is None else {leaf.name: leaf.value for leaf in fields_of(paper)}
    for leaf in fields_of(default):
        allowed = ", ".join(leaf.choices)
        if leaf.low is not None or leaf.high is not None:
            low, high = ("" if v is None else f"{v:g}" for v in (leaf.low, leaf.high))
            allowed = f"{low} .. {high}"
        changed = other.get(leaf.name, leaf.value)
        paper_value = "" if changed == leaf.value else f"{changed}"
        lines.append(f"| `{leaf.name}` | {leaf.value} | {paper_value} | {allowed} | {leaf.meaning} |")
    return lines


def tables():
    """All generated tables by the name of their place in the document."""
    frontend, backend = esfo_frontend.options.PRESETS, esfo_backend.options.PRESETS
    return {
        "frontend": parameter_table(frontend["default"], frontend["paper"]),
        "frontend node": parameter_table(esfo_frontend.live.LiveOptions(), None),
        "backend": parameter_table(backend["default"], backend["paper"]),
        "backend node": parameter_table(esfo_backend.live.LiveOptions(), None),
        "replay": parameter_table(ReplayOptions(), None),
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


def test_every_topic_and_service_is_listed_with_its_type():
    rows = [line.replace("~", "") for line in DOCUMENT.read_text().splitlines() if line.startswith("|")]
    found = set()
    for node in PACKAGES.glob("*/esfo_*/**/node.py"):
        source = node.read_text()
        calls = re.findall(r"create_(?:publisher|subscription|service)\(\s*(?:msg\.)?(\w+),\s*\"([^\"]+)\"", source)
        assert calls or "esfo_core" in str(node), f"{node} has no topic"
        found |= set(calls)
    assert len(found) > 12
    for kind, name in found:
        row = next((row for row in rows if f"`{name.replace('~', '')}" in row), None)
        assert row, f"{name} is not in {DOCUMENT.name}"
        assert kind in row, f"{name} is listed with another type than {kind}"


if __name__ == "__main__":
    DOCUMENT.write_text(with_tables(DOCUMENT.read_text()))
