"""What the package installs besides its modules: entry points, launch file and parameter file name what exists."""

import ast
import importlib
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml

import esfo_backend.options
import esfo_backend.ros.live_backend
import esfo_frontend.online.live_frontend
import esfo_frontend.options
from esfo_bringup.camera_info.options import CameraInfoOptions
from esfo_bringup.replay.player import ReplayOptions
from esfo_core.options import fields_of

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "ros2_ws/src"
BRINGUP = SOURCE / "esfo_bringup"
LAUNCH_FILE = BRINGUP / "launch/esfo.launch.py"
NODES = {
    "frontend": (esfo_frontend.options.FrontendOptions(), esfo_frontend.online.live_frontend.FrontendNodeOptions()),
    "backend": (esfo_backend.options.BackendOptions(), esfo_backend.ros.live_backend.BackendNodeOptions()),
}
OTHERS = (ReplayOptions(), CameraInfoOptions())
OF_ALL_NODES = {"preset", "autostart", "use_sim_time"}


def names(*options):
    return {leaf.name for tree in options for leaf in fields_of(tree)}


ENTRY_POINTS = {
    name: (module, function)
    for path in SOURCE.glob("*/setup.py")
    for name, module, function in re.findall(r'"(\w+) = ([\w.]+):(\w+)"', path.read_text())
}


@pytest.mark.parametrize(("module", "function"), ENTRY_POINTS.values(), ids=ENTRY_POINTS)
def test_every_entry_point_exists(module, function):
    if module.endswith(".node"):
        pytest.importorskip("esfo_msgs.msg", reason="the messages are not built: make setup")
    assert callable(getattr(importlib.import_module(module), function))


def test_every_node_of_the_launch_file_is_an_entry_point():
    text = LAUNCH_FILE.read_text()
    started = set(re.findall(r'"(\w+_node)"', text))
    assert started == {"replay_node", "camera_info_node"}
    assert 'f"{side}_node"' in text
    assert started | {f"{side}_node" for side in NODES} <= set(ENTRY_POINTS)


def test_every_parameter_of_the_launch_file_exists():
    """Keys of the dictionaries in its functions are parameters, or arguments of a Node."""
    functions = [n for n in ast.parse(LAUNCH_FILE.read_text()).body if isinstance(n, ast.FunctionDef)]
    found = {
        key.value
        for function in functions
        for node in ast.walk(function)
        if isinstance(node, ast.Dict)
        for key in node.keys
        if isinstance(key, ast.Constant)
    }
    parameters = found - {"namespace", "output", "remappings", "ros_arguments", "sigterm_timeout"}
    assert len(parameters) >= 9
    assert parameters <= names(*NODES["frontend"], *NODES["backend"], *OTHERS) | OF_ALL_NODES


def launch_arguments():
    tree = ast.parse(LAUNCH_FILE.read_text())
    (table,) = (n.value for n in tree.body if isinstance(n, ast.Assign) and n.targets[0].id == "ARGUMENTS")
    return {key.value for key in table.keys}


@pytest.mark.parametrize("name", ["README.md", "docs/ros.md", "docker/compose.yaml", LAUNCH_FILE])
def test_launch_lines_of_the_documents_use_arguments_that_exist(name):
    text = (ROOT / name).read_text().replace("launch.py\n", "launch.py ")
    lines = [line for line in text.splitlines() if "esfo.launch.py" in line]
    used = {word for line in lines for word in re.findall(r"(\w+):=", line.partition("esfo.launch.py")[2])}
    assert used
    assert used <= launch_arguments()


def test_the_example_of_the_parameter_file_names_what_exists():
    lines = (BRINGUP / "config/esfo.yaml").read_text().splitlines()
    assert yaml.safe_load("\n".join(lines)) == {"/**": {"ros__parameters": {}}}
    begin = next(i for i, line in enumerate(lines) if line.startswith("# /**/"))
    example = yaml.safe_load("\n".join(line[2:] for line in lines[begin:] if line.startswith("# ")))
    for pattern, block in example.items():
        known = names(*NODES[pattern.rpartition("/")[2]])
        for stage, values in block["ros__parameters"].items():
            for field in values:
                assert f"{stage}.{field}" in known


def test_everything_shared_is_installed():
    folders = {path.name for path in BRINGUP.iterdir() if path.is_dir()}
    shared = ast.literal_eval(re.search(r"SHARED = (\(.*?\))", (BRINGUP / "setup.py").read_text())[1])
    assert {"launch", "config", "rviz", "foxglove"} == set(shared) <= folders


def ros_imports(package):
    """ROS packages and own packages that the modules of a package import."""
    for path in (SOURCE / package / package).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                yield from (alias.name.partition(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                yield node.module.partition(".")[0]


@pytest.mark.parametrize("package", sorted(path.parent.name for path in SOURCE.glob("*/setup.py")))
def test_package_xml_names_the_ros_packages_that_are_imported(package):
    root = ET.parse(SOURCE / package / "package.xml").getroot()
    declared = {element.text for element in root.iter("exec_depend")}
    is_ros = re.compile(r"rclpy|rosidl_\w+|ament_\w+|esfo_\w+|\w+_(msgs|interfaces|srvs)")
    used = {name for name in ros_imports(package) if is_ros.fullmatch(name)} - {package}
    assert used <= declared, f"{package}/package.xml lacks {sorted(used - declared)}"
