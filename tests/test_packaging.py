"""pyproject.toml: what `pip install .` brings, beside what colcon and the pinned requirements say."""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement
from test_architecture import ROS_ROOMS, SOURCE, inside, is_ros, modules
from test_architecture import imported as names_imported

from esfo_core.camera import Camera
from esfo_core.events import make_events
from esfo_core.recordings import write_mcap

ROOT = Path(__file__).parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = PYPROJECT["project"]
NEED_ROS = {"esfo_ros", "esfo_msgs"}


def pins(name):
    lines = (line.partition("#")[0].strip() for line in (ROOT / "requirements" / name).read_text().splitlines())
    return dict(line.split("==") for line in lines if line)


@pytest.mark.parametrize(
    ("file", "declared"),
    [("runtime.txt", PROJECT["dependencies"]), ("formats.txt", PROJECT["optional-dependencies"]["formats"])],
)
def test_dependencies_are_the_pinned_ones_and_admit_the_pins(file, declared):
    requirements = [Requirement(text) for text in declared]
    assert {r.name for r in requirements} == set(pins(file))
    assert len(requirements) == len(pins(file))
    for requirement in requirements:
        assert requirement.specifier.contains(pins(file)[requirement.name]), requirement
        assert not requirement.specifier.contains("9999"), f"{requirement} has no upper bound"


def test_the_python_versions_are_those_of_the_setup():
    assert PROJECT["requires-python"] == ">=3.11,<3.13"
    assert "(3, 11) <= sys.version_info[:2] <= (3, 12)" in (ROOT / "scripts/setup.sh").read_text()


def test_the_version_comes_from_the_library():
    assert PROJECT["dynamic"] == ["version"]
    assert PYPROJECT["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "esfo_core.__version__"}


def test_the_command_is_that_of_the_workspace():
    text = (SOURCE / "esfo_bringup/setup.py").read_text()
    assert PROJECT["scripts"] == {"esfo": re.search(r'"esfo = ([\w.:]+)"', text)[1]}


def test_every_package_that_needs_no_ros_is_found():
    found = {Path(folder).name for folder in PYPROJECT["tool"]["setuptools"]["packages"]["find"]["where"]}
    assert found == {path.parent.name for path in SOURCE.glob("*/package.xml")} - NEED_ROS


def test_the_wheel_holds_every_module(tmp_path):
    """Built from a copy, because setuptools leaves files in the tree that it builds from."""
    shutil.copytree(SOURCE, tmp_path / "ros2_ws/src", ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    build = "import sys, setuptools.build_meta as b; b.build_wheel(sys.argv[1])"
    subprocess.run([sys.executable, "-c", build, "."], cwd=tmp_path, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("esfo-*-py3-none-any.whl")
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if name.endswith(".py")}
    expected = {
        name.replace(".", "/") + ("/__init__.py" if path.name == "__init__.py" else ".py")
        for name, path in modules(SOURCE).items()
        if not inside(name, NEED_ROS)
    }
    assert held == expected


WITHOUT_ROS = """
import importlib, sys
class NoRos:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, NoRos())
sys.modules["rclpy"] = None  # so that it is not found by find_spec either
{code}
"""


@pytest.fixture(scope="module")
def ros_packages():
    """Names of all packages that need ROS and are imported somewhere."""
    imported = {
        name.partition(".")[0]
        for module, path in modules(SOURCE).items()
        for node in ast.walk(ast.parse(path.read_text()))
        for name in names_imported(node, module, False)
    }
    found = {name for name in imported if is_ros(name)} | {"esfo_ros"}
    assert {"rclpy", "esfo_msgs", "std_msgs", "ament_index_python"} <= found
    return found


def run_without(blocked, code):
    command = [sys.executable, "-c", WITHOUT_ROS.format(blocked=blocked, code=code)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_what_needs_no_ros_imports_without_it(ros_packages):
    names = [name for name in modules(SOURCE) if not inside(name, (*ROS_ROOMS, "esfo_bringup.live.__main__"))]
    assert {"esfo.steps", "esfo_frontend.frontend", "esfo_bringup.commands.live"} <= set(names)
    done = run_without(ros_packages, f"for name in {names}: importlib.import_module(name)")
    assert done.returncode == 0, done.stderr


@pytest.fixture
def noise(tmp_path):
    """A recording in which nothing moves."""
    rng = np.random.default_rng(0)
    t = 10**9 + np.sort(rng.integers(0, 300_000_000, 1000))
    columns = rng.integers(0, 64, 1000), rng.integers(0, 48, 1000), rng.integers(0, 2, 1000)
    write_mcap(tmp_path / "noise.mcap", [make_events(*columns, t)], Camera.pinhole(64, 48, 80.0))
    return tmp_path / "noise.mcap"


def test_run_without_ros_says_why_there_is_no_result_bag(ros_packages, noise):
    out = noise.parent / "out"
    code = f"from esfo_bringup.cli import main; sys.exit(main(['run', {str(noise)!r}, '-o', {str(out)!r}]))"
    done = run_without(ros_packages, code)
    assert f"not written {out}/result.mcap: the ROS messages cannot be loaded (No module named " in done.stdout
    assert (out / "report.html").exists()


def test_live_without_ros_says_so_in_one_line(ros_packages, noise):
    code = f"from esfo_bringup.cli import main; sys.exit(main(['live', {str(noise)!r}, '-o', '.']))"
    done = run_without(ros_packages, code)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "esfo: ROS 2 is not in this environment: source a Jazzy install, or use make setup\n"
