"""Launch the front-end and the back-end for a camera that is running, or for a recording that is replayed.

ros2 launch esfo_bringup esfo.launch.py bag:=scene.mcap
ros2 launch esfo_bringup esfo.launch.py camera:=cal.yaml events:=/event_camera/events camera_frame:=event_camera
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch.utilities.type_utils import perform_typed_substitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile
from launch_ros.substitutions import FindPackageShare
from launch_ros.utilities import prefix_namespace

from launch import LaunchDescription

SHARE = FindPackageShare("esfo_bringup")
ARGUMENTS = {
    "bag": ("", "recording to replay, in any format that `esfo info` reads; empty: events come from a driver"),
    "rate": ("1.0", "speed of the replay; 0: as fast as the pipeline acknowledges"),
    "camera": ("", "calibration YAML to publish on camera_info; empty: from the recording or the driver"),
    "events": ("events", "topic of the event packets"),
    "camera_info": ("camera_info", "topic of the calibration"),
    "events_reliability": (
        "auto",
        "QoS of the event subscription; auto: reliable for a replay, otherwise the node's parameter",
        ["auto", "best_effort", "reliable"],
    ),
    "camera_frame": ("", "camera frame for packets without frame_id, and fixed frame of RViz; empty: NAMESPACE/camera"),
    "object_frame": ("", "object frame on /tf; empty: NAMESPACE/object"),
    "namespace": ("", "namespace of all nodes; use a different one for each pipeline"),
    "preset": ("default", "default values of the options that params_file does not set", ["default", "paper"]),
    "params_file": (PathJoinSubstitution([SHARE, "config", "esfo.yaml"]), "YAML file with parameters of the nodes"),
    "autostart": ("true", "the nodes configure and activate themselves; false: a lifecycle manager does"),
    "use_sim_time": ("auto", "use time from a clock topic, true or false; auto: true when a bag is replayed"),
    "clock": ("", "clock topic; empty: NAMESPACE/clock when a bag is replayed, otherwise /clock"),
    "log_level": ("info", "lowest severity that the nodes log", ["debug", "info", "warn", "error", "fatal"]),
    "rviz": ("false", "open RViz"),
}


def generate_launch_description():
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=meaning, choices=choices[0] if choices else None)
        for name, (default, meaning, *choices) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context):
    """Return the nodes for the given arguments."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    bag, camera, params_file = (file(given, argument) for argument in ("bag", "camera", "params_file"))
    camera_frame, object_frame = frames(context, given)
    time = {"use_sim_time": bool(bag) if given["use_sim_time"] == "auto" else flag(context, "use_sim_time")}
    shared = {"preset": given["preset"], "autostart": flag(context, "autostart"), **time}
    frontend = {"camera_frame": camera_frame, "wait_for_back_end": bool(bag), **reliability(given, bag)}
    shape = {
        "namespace": given["namespace"],
        "output": "screen",
        "ros_arguments": ["--log-level", given["log_level"]],
        "sigterm_timeout": "15",  # longer than a node needs to finish an estimate
        "remappings": [
            ("events", given["events"]),
            ("camera_info", given["camera_info"]),
            ("/clock", given["clock"] or ("clock" if bag else "/clock")),  # each of two replays has its own time
        ],
    }
    started = [
        Node(
            package=f"esfo_{side}",
            executable=f"{side}_node",
            parameters=[{**shared, **own}, ParameterFile(params_file, allow_substs=True)],
            on_exit=Shutdown(reason=f"the {side} ended"),
            **shape,
        )
        for side, own in (("frontend", frontend), ("backend", {"object_frame": object_frame}))
    ]
    calibration = {"camera": camera, "frame_id": camera_frame}
    if bag:
        own = {"recording": bag, "rate": float(given["rate"]), **calibration}
        started.append(source("replay_node", own, shape))
    elif camera:
        started.append(source("camera_info_node", calibration, shape))
    if flag(context, "rviz"):
        config = PathJoinSubstitution([SHARE, "rviz", "esfo.rviz"])
        arguments = ["-d", config, "-f", camera_frame]
        started.append(Node(package="rviz2", executable="rviz2", arguments=arguments, parameters=[time], **shape))
    return started


def source(executable, parameters, shape):
    """Return a node that publishes the input of the others; its end shuts the launch down only after an error."""
    return Node(
        package="esfo_bringup",
        executable=executable,
        parameters=[parameters],
        on_exit=lambda event, _: [Shutdown(reason=f"{executable} failed")] if event.returncode else None,
        **shape,
    )


def frames(context, given):
    """Return the frames of the camera and of the object; /tf is global, so their names contain the namespace."""
    space = prefix_namespace(context.launch_configurations.get("ros_namespace"), given["namespace"])
    prefix = f"{space.strip('/')}/".lstrip("/")
    return given["camera_frame"] or f"{prefix}camera", given["object_frame"] or f"{prefix}object"


def reliability(given, bag):
    """Return the QoS parameter of the events: reliable for a replay; for a camera, the default of the node."""
    chosen = given["events_reliability"]
    if chosen == "auto":
        return {"events.reliability": "reliable"} if bag else {}
    return {"events.reliability": chosen}


def file(given, argument):
    """Return the path in an argument, with ~ expanded, which no shell does after `:=`; empty for an empty argument."""
    if not given[argument]:
        return ""
    path = Path(given[argument]).expanduser()
    if not path.exists():
        raise FileNotFoundError(f"{argument}: there is no {path}")
    return str(path)


def flag(context, name):
    return perform_typed_substitution(context, [LaunchConfiguration(name)], bool)
