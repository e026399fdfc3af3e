"""The arrows between the packages, and where ROS may be imported: read from the source, nothing is imported."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "ros2_ws" / "src"
MAY_IMPORT = {
    "esfo_core": set(),
    "esfo_simulation": {"esfo_core"},
    "esfo_ros": {"esfo_core"},
    "esfo_frontend": {"esfo_core", "esfo_ros"},
    "esfo_backend": {"esfo_core", "esfo_ros"},
    "esfo_bringup": {"esfo_core", "esfo_simulation", "esfo_ros", "esfo_frontend", "esfo_backend"},
    "esfo": {"esfo_core", "esfo_simulation", "esfo_frontend", "esfo_backend", "esfo_bringup"},
}
HOMES = {"esfo": "esfo_bringup"}
"""Folders of the packages that are not in one of their own name."""

ROOMS = {
    "esfo_core": ("codecs", "recordings", "evaluation"),
    "esfo_simulation": ("render", "objects", "sensor", "handheld"),
    "esfo_ros": (),
    "esfo_frontend": ("corners", "clustering.hdbscan", "clustering", "association", "online", "ros"),
    "esfo_backend": ("orbit", "spin_rate", "adjustment", "initialise", "landmarks", "verdict", "online", "ros"),
    "esfo_bringup": ("offline", "results", "benchmark", "replay", "camera_info", "result_bag", "commands", "live"),
    "esfo": (),
}
"""Sub-packages of each package, in the order in which data goes through: a room imports only rooms before it."""

ROS_ROOMS = (
    "esfo_ros",
    "esfo_frontend.ros",
    "esfo_backend.ros",
    "esfo_bringup.replay.node",
    "esfo_bringup.replay.messages",
    "esfo_bringup.camera_info.node",
    "esfo_bringup.live.node",
    "esfo_bringup.result_bag",
)
"""Where rclpy and message types may be imported; of them, the packages above `esfo_ros` need it for everything."""

LATE_IMPORTS = {"esfo_bringup.commands": None, "esfo_frontend.clustering.hdbscan.package": "hdbscan"}
"""Where a function may import: commands, for their start-up time, and a package that only one option needs."""

IMPORTS_BY_NAME = {"esfo_frontend.ros.node"}
"""Modules that may import by a string: the event messages that happen to be installed."""

ROS_PREFIXES = ("rclpy", "ros2", "launch", "ament_", "rosidl", "tf2")


def folder_of(package: str, source: Path) -> Path:
    """Folder with the modules of a package."""
    return source / HOMES.get(package, package) / package


def modules(source: Path) -> dict[str, Path]:
    """Dotted names of all modules of the packages under `source`."""
    found = {}
    for package in MAY_IMPORT:
        folder = folder_of(package, source)
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder.parent).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported(node: ast.AST, module: str, is_package: bool) -> list[str]:
    """Every dotted name that an import statement may load; for `from a import b` both a and a.b."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        base = node.module or ""
        if node.level:
            up = module.split(".")[: len(module.split(".")) - node.level + is_package]
            base = ".".join([*up, *([base] if base else [])])
        return [base, *(f"{base}.{alias.name}" for alias in node.names)]
    return []


def is_ros(name: str) -> bool:
    top = name.split(".", maxsplit=1)[0]
    return top.startswith(ROS_PREFIXES) or top.endswith(("_msgs", "_interfaces")) or top == "std_srvs"


def inside(module: str, places: Iterable[str]) -> bool:
    return any(module == place or module.startswith(place + ".") for place in places)


def room_of(module: str) -> str | None:
    """Name the room that a module is in, None for the top of its package."""
    package, _, rest = module.partition(".")
    found = [room for room in ROOMS[package] if rest == room or rest.startswith(room + ".")]
    return max(found, key=len, default=None)


def late_imports(module: str, tree: ast.AST) -> list[str]:
    """Import statements inside of functions that have no business there."""
    wrong = []
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        for node in ast.walk(function):
            if isinstance(node, ast.Import | ast.ImportFrom):
                allowed = [top for place, top in LATE_IMPORTS.items() if inside(module, [place])]
                names = {name.split(".")[0] for name in imported(node, module, False)}
                if not allowed or (allowed[0] is not None and names != {allowed[0]}):
                    wrong.append(f"{module}: imports inside of {function.name}")
    return wrong


def arrow_faults(module: str, name: str) -> list[str]:
    """What is wrong with `module` importing `name`."""
    package, top, wrong = module.split(".", maxsplit=1)[0], name.split(".", maxsplit=1)[0], []
    if top in MAY_IMPORT and top != package and top not in MAY_IMPORT[package]:
        wrong.append(f"{module}: {package} must not import {name}")
    if (is_ros(name) or top == "esfo_ros") and not inside(module, ROS_ROOMS):
        wrong.append(f"{module}: imports {name}, which needs ROS")
    if top == package:
        here, there, order = room_of(module), room_of(name), ROOMS[package]
        if here is not None and there is not None and order.index(there) > order.index(here):
            wrong.append(f"{module}: an arrow up, from {here} to {there}")
    return wrong


def violations(source: Path) -> list[str]:
    known = modules(source)
    wrong, graph = [], {}
    for module, path in known.items():
        if path.name == "utils.py":
            wrong.append(f"{module}: a name that says nothing")
        text = path.read_text()
        tree = ast.parse(text)
        wrong += late_imports(module, tree)
        if re.search(r"\b(import_module|__import__)\b", text) and module not in IMPORTS_BY_NAME:
            wrong.append(f"{module}: imports by a string")
        names = [name for node in ast.walk(tree) for name in imported(node, module, path.name == "__init__.py")]
        for name in names:
            wrong += arrow_faults(module, name)
        # Importing a.b.c runs a and a.b first, but they are on the way and no dependency of their own.
        graph[module] = {
            name for name in names if name in known and name != module and not module.startswith(name + ".")
        }
    return sorted(set(wrong)) + [f"import cycle: {' -> '.join(cycle)}" for cycle in cycles(graph)]


def cycles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return one cycle for each module from which a depth-first walk comes back to itself."""
    found, done = [], set()

    def walk(module: str, trail: list[str]) -> None:
        if module in trail:
            found.append([*trail[trail.index(module) :], module])
        elif module not in done:
            for name in sorted(graph.get(module, ())):
                walk(name, [*trail, module])
            done.add(module)

    for module in graph:
        walk(module, [])
    return found


def test_arrows_hold():
    assert len(modules(SOURCE)) > 20
    assert violations(SOURCE) == []


def test_every_room_is_known():
    for package, rooms in ROOMS.items():
        folder = folder_of(package, SOURCE)
        found = {".".join(p.parent.relative_to(folder).parts) for p in folder.rglob("__init__.py")} - {""}
        assert found == set(rooms), package


def test_both_ends_never_meet():
    for module, path in modules(SOURCE).items():
        other = {"esfo_frontend": "esfo_backend", "esfo_backend": "esfo_frontend"}.get(module.split(".")[0])
        assert other is None or f"import {other}" not in path.read_text(), module


BROKEN = {
    "frontend imports backend": ("esfo_frontend/a.py", "from esfo_backend import b", "must not import esfo_backend"),
    "core imports frontend": ("esfo_core/a.py", "import esfo_frontend.corners", "must not import esfo_frontend"),
    "ROS in the library": ("esfo_core/a.py", "import rclpy.node", "imports rclpy.node"),
    "messages in the library": (
        "esfo_backend/a.py",
        "from esfo_msgs.msg import OrbitEstimate",
        "imports esfo_msgs.msg",
    ),
    "hidden import": ("esfo_core/a.py", "def f():\n    import math\n", "imports inside of f"),
    "hidden in a method": ("esfo_core/a.py", "class A:\n    async def f(self):\n        import math\n", "inside of f"),
    "hidden by a string": ("esfo_core/a.py", "import importlib\nimportlib.import_module('x')", "imports by a string"),
    "another package in the place of one": (
        "esfo_frontend/clustering/hdbscan/package.py",
        "def f():\n    import sklearn\n",
        "imports inside of f",
    ),
    "arrow up": ("esfo_backend/orbit/a.py", "from esfo_backend.online import b", "an arrow up, from orbit to online"),
    "nodes' business in the library": ("esfo_backend/a.py", "from esfo_ros import topics", "which needs ROS"),
    "dumping ground": ("esfo_core/deep/utils.py", "", "a name that says nothing"),
    "ROS in the Python API": ("esfo/a.py", "import rclpy", "imports rclpy, which needs ROS"),
    "command imports the Python API": ("esfo_bringup/a.py", "import esfo", "esfo_bringup must not import esfo"),
    "relative arrow": ("esfo_core/deep/a.py", "from ...esfo_backend import x", "must not import esfo_backend"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_arrow_is_found(tmp_path, case):
    name, text, expected = BROKEN[case]
    path = folder_of(name.split("/")[0], tmp_path).parent / name
    path.parent.mkdir(parents=True)
    path.write_text(text)
    found = violations(tmp_path)
    assert found, case
    assert all(expected in line for line in found)


@pytest.mark.parametrize(
    "form", ["import esfo_core.b", "from esfo_core import b", "from . import b", "from .b import x"]
)
def test_an_import_cycle_is_found(tmp_path, form):
    folder = tmp_path / "esfo_core" / "esfo_core"
    folder.mkdir(parents=True)
    (folder / "a.py").write_text(form)
    (folder / "b.py").write_text("from esfo_core.c import y")
    (folder / "c.py").write_text("import esfo_core.a")
    assert violations(tmp_path) == ["import cycle: esfo_core.a -> esfo_core.b -> esfo_core.c -> esfo_core.a"]


def test_ros_is_allowed_at_the_edge(tmp_path):
    folder = tmp_path / "esfo_backend" / "esfo_backend" / "ros"
    folder.mkdir(parents=True)
    (folder / "node.py").write_text("import rclpy\nfrom esfo_core import orbit\nfrom esfo_backend.ros import messages")
    (folder / "messages.py").write_text("from esfo_msgs.msg import OrbitEstimate")
    assert violations(tmp_path) == []


def test_a_command_may_load_late(tmp_path):
    folder = tmp_path / "esfo_bringup" / "esfo_bringup" / "commands"
    folder.mkdir(parents=True)
    (folder / "run.py").write_text("def execute():\n    from esfo_backend import backend\n")
    assert violations(tmp_path) == []
