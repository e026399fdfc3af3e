"""The launch file: what it starts, with which names, frames and parameters; the wheels have no `launch`."""

import pytest

pytest.importorskip("launch_ros.actions", reason="no launch_ros here: ROS comes as wheels", exc_type=ImportError)

from launching import add_package, started

from esfo_backend.options import BackendOptions
from esfo_backend.ros.live_backend import BackendNodeOptions
from esfo_bringup.camera_info.options import CameraInfoOptions
from esfo_bringup.replay.player import ReplayOptions
from esfo_core.options import fields_of
from esfo_frontend.online.live_frontend import FrontendNodeOptions
from esfo_frontend.options import FrontendOptions


@pytest.fixture(autouse=True)
def files(tmp_path, monkeypatch):
    """A working directory, which is home too, with what the arguments name."""
    home = tmp_path / "home"
    home.mkdir()
    for name in ("1.50", "scene.mcap", "cal.yaml"):
        (home / name).touch()
    monkeypatch.chdir(home)
    monkeypatch.setenv("HOME", str(home))
    return home


PIPELINE = {"frontend_node", "backend_node"}
OPTIONS = {
    "frontend_node": (FrontendOptions(), FrontendNodeOptions()),
    "backend_node": (BackendOptions(), BackendNodeOptions()),
    "replay_node": (ReplayOptions(),),
    "camera_info_node": (CameraInfoOptions(),),
}
COMMON = {"preset": str, "autostart": bool, "use_sim_time": bool}


def known(executable):
    """Every parameter that a node declares, with the type of its value."""
    fields = [leaf for options in OPTIONS[executable] for leaf in fields_of(options)]
    return {leaf.name: type(leaf.value) for leaf in fields} | (COMMON if executable in PIPELINE else {})


def check_parameters(nodes):
    """Every parameter that is set exists, and has the type that the node takes."""
    for executable, node in nodes.items():
        for name, value in node.parameters.items():
            assert known(executable).get(name) is type(value), f"{executable} {name}: {value!r}"


def test_a_recording_is_replayed_in_its_own_time(tmp_path, files):
    nodes = started(tmp_path, 3, bag=f"{files}/scene.mcap", rate="0", log_level="warn")
    assert set(nodes) == {*PIPELINE, "replay_node"}
    check_parameters(nodes)
    assert nodes["replay_node"].parameters == {
        "recording": f"{files}/scene.mcap",
        "camera": "",
        "rate": 0.0,
        "frame_id": "camera",
    }
    for name in PIPELINE:
        assert nodes[name].parameters["use_sim_time"] is True
        assert nodes[name].parameters["autostart"] is True
    assert nodes["frontend_node"].parameters["events.reliability"] == "reliable"
    assert nodes["frontend_node"].parameters["wait_for_back_end"] is True
    for node in nodes.values():
        assert node.remappings["/clock"] == "clock"
        at = node.arguments.index("--log-level")
        assert node.arguments[at + 1] == "warn"


def test_a_recording_whose_name_looks_like_a_number_keeps_it(tmp_path):
    nodes = started(tmp_path, 3, bag="1.50")
    assert nodes["replay_node"].parameters["recording"] == "1.50"


def test_a_camera_is_taken_as_its_driver_sends(tmp_path):
    nodes = started(tmp_path, 2, events="/event_camera/events", camera_info="/event_camera/camera_info")
    assert set(nodes) == PIPELINE
    check_parameters(nodes)
    for node in nodes.values():
        assert node.parameters["use_sim_time"] is False
        assert node.remappings["events"] == "/event_camera/events"
        assert node.remappings["camera_info"] == "/event_camera/camera_info"
        assert node.remappings["/clock"] == "/clock"
    assert "events.reliability" not in nodes["frontend_node"].parameters
    assert nodes["frontend_node"].parameters["wait_for_back_end"] is False


def test_a_calibration_without_a_recording_is_published(tmp_path, files):
    nodes = started(tmp_path, 3, camera="~/cal.yaml", camera_frame="davis", camera_info="/davis/camera_info")
    check_parameters(nodes)
    node = nodes["camera_info_node"]
    assert node.parameters == {"camera": f"{files}/cal.yaml", "frame_id": "davis"}
    assert node.remappings["camera_info"] == "/davis/camera_info"


@pytest.mark.parametrize(
    ("pushed", "given", "prefix"),
    [("", "left", "left/"), ("robot", "left", "robot/left/"), ("robot", "/left", "left/")],
)
def test_two_pipelines_share_no_frame_and_no_clock(tmp_path, pushed, given, prefix):
    nodes = started(tmp_path, 3, pushed_namespace=pushed, namespace=given, bag="scene.mcap")
    assert nodes["backend_node"].parameters["object_frame"] == f"{prefix}object"
    assert nodes["frontend_node"].parameters["camera_frame"] == f"{prefix}camera"
    assert nodes["replay_node"].parameters["frame_id"] == f"{prefix}camera"
    for node in nodes.values():
        assert node.remappings["__ns"] == f"/{prefix}".rstrip("/")
        assert node.remappings["/clock"] == "clock"


def test_what_is_given_wins(tmp_path):
    given = {"autostart": "false", "use_sim_time": "false", "preset": "paper", "clock": "/clock"}
    frames = {"camera_frame": "sensor", "object_frame": "target", "events_reliability": "best_effort"}
    nodes = started(tmp_path, 3, bag="scene.mcap", **given, **frames)
    check_parameters(nodes)
    for name in PIPELINE:
        set_to = {k: nodes[name].parameters[k] for k in COMMON}
        assert set_to == {"autostart": False, "use_sim_time": False, "preset": "paper"}
        assert nodes[name].remappings["/clock"] == "/clock"
    assert nodes["backend_node"].parameters["object_frame"] == "target"
    assert nodes["frontend_node"].parameters["camera_frame"] == "sensor"
    assert nodes["frontend_node"].parameters["events.reliability"] == "best_effort"


def test_a_parameter_file_wins_over_the_arguments(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("/**: {ros__parameters: {preset: paper, live: {interval_s: 0.5}}}")
    nodes = started(tmp_path, 2, params_file=str(file))
    assert nodes["backend_node"].parameters["preset"] == "paper"
    assert nodes["backend_node"].parameters["live"] == {"interval_s": 0.5}


def test_rviz_looks_from_the_camera_of_the_namespace(tmp_path, monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", add_package(tmp_path / "prefix", "rviz2"))
    nodes = started(tmp_path, 4, namespace="left", rviz="true", bag="scene.mcap")
    rviz = nodes["rviz2"]
    assert rviz.parameters == {"use_sim_time": True}
    assert rviz.remappings["__ns"] == "/left"
    assert rviz.arguments[rviz.arguments.index("-f") + 1] == "left/camera"
    assert rviz.arguments[rviz.arguments.index("-d") + 1].endswith("rviz/esfo.rviz")


@pytest.mark.parametrize("argument", ["bag", "camera", "params_file"])
def test_a_file_that_is_not_there_is_named_before_anything_starts(tmp_path, argument, caplog):
    assert started(tmp_path, 0, **{argument: "none.yaml"}, expected_result=1) == {}
    assert f"{argument}: there is no none.yaml" in caplog.text
