"""What the package installs besides its modules: entry points, launch file and parameter file name what exists."""

import ast
import importlib
import re
import sys
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


def imports(package):
    """Packages that the modules and launch files of a package import."""
    for path in (SOURCE / package).rglob("*.py"):
        if path.name == "setup.py":
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                yield from (alias.name.partition(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                yield node.module.partition(".")[0]


def declared(package):
    return {element.text for element in ET.parse(SOURCE / package / "package.xml").getroot().iter("exec_depend")}


PYTHON_PACKAGES = sorted(path.parent.name for path in SOURCE.glob("*/setup.py"))
ROS_PACKAGE = re.compile(r"rclpy|launch\w*|rosidl_\w+|ament_\w+|esfo_\w+|\w+_(msgs|interfaces|srvs)")
DISTRIBUTIONS = {"PIL": "pillow", "backports": "backports.zstd", "llvmlite": "numba", "yaml": "PyYAML"}
"""Distributions that are not called as what is imported; llvmlite comes with numba."""
UNSEEN = {"esfo_simulation": {"pillow"}}
"""Distributions that a package needs without importing them: trimesh reads textures by Pillow."""
OPTIONAL = {"hdf5plugin"}


def rosdep_keys():
    """Key of each pinned distribution, as requirements/ says; `-` where there is none."""
    lines = [line for name in ("runtime.txt", "formats.txt") for line in (ROOT / "requirements" / name).open()]
    return dict(re.fullmatch(r"(\S+)==\S+ +# rosdep: (\S+)\n", line).groups() for line in lines if line[0] != "#")


def distributions(package):
    """Third-party distributions that a package needs when it runs."""
    names = {name for name in imports(package) if not ROS_PACKAGE.fullmatch(name)}
    names -= {*sys.stdlib_module_names, "esfo", *OPTIONAL}
    return {DISTRIBUTIONS.get(name, name) for name in names} | UNSEEN.get(package, set())


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_package_xml_names_the_ros_packages_that_are_imported(package):
    used = {name for name in imports(package) if ROS_PACKAGE.fullmatch(name)} - {package}
    assert used <= declared(package), f"{package}/package.xml lacks {sorted(used - declared(package))}"


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_package_xml_names_every_third_party_import(package):
    keys = rosdep_keys()
    used = distributions(package)
    assert used <= keys.keys(), f"not in requirements/: {sorted(used - keys.keys())}"
    assert {key for key in declared(package) if key.startswith("python3-")} == {keys[name] for name in used} - {"-"}
    comment = re.search(
        r"<!-- Without a rosdep key, by requirements/runtime.txt: (.*?) -->",
        (SOURCE / package / "package.xml").read_text(),
    )
    assert set(comment[1].split(", ") if comment else ()) == {name for name in used if keys[name] == "-"}


def test_every_pinned_distribution_is_used():
    assert set.union(*(distributions(package) for package in PYTHON_PACKAGES)) == rosdep_keys().keys()


def test_no_apt_package_takes_the_place_of_a_pinned_one():
    text = (ROOT / "scripts/system_packages.sh").read_text()
    assert set(re.search(r"locked=\((.*?)\)", text, re.DOTALL)[1].split()) == set(rosdep_keys().values()) - {"-"}
