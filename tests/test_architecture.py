"""The arrows between the packages, and where ROS may be imported: read from the source, nothing is imported."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "ros2_ws" / "src"
MAY_IMPORT = {
    "esfo_core": set(),
    "esfo_frontend": {"esfo_core"},
    "esfo_backend": {"esfo_core"},
    "esfo_bringup": {"esfo_core", "esfo_frontend", "esfo_backend"},
}
ROS_FILES = ("node.py", "messages.py")
ROS_PREFIXES = ("rclpy", "ros2", "launch", "ament_", "rosidl", "tf2")


def modules(source: Path) -> dict[str, Path]:
    """Dotted names of all modules of the packages under `source`."""
    found = {}
    for package in MAY_IMPORT:
        for path in sorted((source / package / package).rglob("*.py")):
            parts = path.relative_to(source / package).with_suffix("").parts
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


def violations(source: Path) -> list[str]:
    known = modules(source)
    wrong, graph = [], {}
    for module, path in known.items():
        package = module.split(".")[0]
        if path.name == "utils.py":
            wrong.append(f"{module}: a name that says nothing")
        tree = ast.parse(path.read_text())
        names = []
        for node in ast.walk(tree):
            names += imported(node, module, path.name == "__init__.py")
            inner = [n for n in ast.walk(node) if isinstance(n, ast.Import | ast.ImportFrom)]
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and inner:
                wrong.append(f"{module}: imports inside of {node.name}")
        for name in names:
            top = name.split(".")[0]
            if top in MAY_IMPORT and top != package and top not in MAY_IMPORT[package]:
                wrong.append(f"{module}: {package} must not import {name}")
            if is_ros(name) and path.name not in ROS_FILES:
                wrong.append(f"{module}: imports {name}, which only {' and '.join(ROS_FILES)} may")
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
    "dumping ground": ("esfo_core/deep/utils.py", "", "a name that says nothing"),
    "relative arrow": ("esfo_core/deep/a.py", "from ...esfo_backend import x", "must not import esfo_backend"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_arrow_is_found(tmp_path, case):
    name, text, expected = BROKEN[case]
    path = tmp_path / name.split("/")[0] / name
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
    folder = tmp_path / "esfo_backend" / "esfo_backend"
    folder.mkdir(parents=True)
    (folder / "node.py").write_text("import rclpy\nfrom esfo_core import orbit\nfrom esfo_backend import messages")
    (folder / "messages.py").write_text("from esfo_msgs.msg import OrbitEstimate")
    assert violations(tmp_path) == []
