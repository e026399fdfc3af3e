"""Launch the front-end and the back-end, and on request a replay, RViz and a namespace around them.

ros2 launch esfo_bringup esfo.launch.py recording:=scene.mcap rviz:=true
ros2 launch esfo_bringup esfo.launch.py events:=/event_camera/events camera_info:=/event_camera/camera_info
"""

from launch.actions import DeclareLaunchArgument, EmitEvent, GroupAction, RegisterEventHandler
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node, PushRosNamespace
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

ARGUMENTS = {
    "namespace": ("", "namespace of all nodes"),
    "preset": ("default", "option preset of both nodes: default or paper"),
    "events": ("events", "topic of the event packets"),
    "camera_info": ("camera_info", "topic of the calibration"),
    "recording": ("", "recording to replay; empty: a camera is running"),
    "camera": ("", "calibration YAML for the replay; empty: the one in the recording"),
    "rate": ("1.0", "speed of the replay; 0: as fast as nothing is lost"),
    "params": (
        PathJoinSubstitution([FindPackageShare("esfo_bringup"), "config", "esfo.yaml"]),
        "parameter file for the nodes",
    ),
    "rviz": ("false", "open RViz"),
}


def generate_launch_description():
    replays = PythonExpression(["'", LaunchConfiguration("recording"), "' != ''"])
    topics = [(name, LaunchConfiguration(name)) for name in ("events", "camera_info")]
    shared = {"preset": text("preset"), "use_sim_time": ParameterValue(replays, value_type=bool)}
    shape = {"output": "screen", "remappings": topics}
    params = ParameterFile(LaunchConfiguration("params"), allow_substs=True)
    # A replay waits for its listeners and sends reliably; of a camera it is not known that it does.
    reliability = PythonExpression(["'reliable' if '", LaunchConfiguration("recording"), "' else 'best_effort'"])
    replayed = {
        "wait_for_back_end": ParameterValue(replays, value_type=bool),
        "events.reliability": ParameterValue(reliability, value_type=str),
    }
    frontend = Node(package="esfo_frontend", executable="frontend_node", parameters=[shared, replayed, params], **shape)
    backend = Node(package="esfo_backend", executable="backend_node", parameters=[shared, params], **shape)
    replay = Node(
        package="esfo_bringup",
        executable="replay_node",
        parameters=[
            {
                "recording": text("recording"),
                "camera": text("camera"),
                "rate": ParameterValue(LaunchConfiguration("rate"), value_type=float),
            }
        ],
        condition=IfCondition(replays),
        **shape,
    )
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", PathJoinSubstitution([FindPackageShare("esfo_bringup"), "rviz", "esfo.rviz"])],
        parameters=[{"use_sim_time": ParameterValue(replays, value_type=bool)}],
        condition=IfCondition(LaunchConfiguration("rviz")),
    )
    nodes = [frontend, backend, replay, rviz]
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(name, default_value=d, description=m) for name, (d, m) in ARGUMENTS.items()),
            GroupAction([PushRosNamespace(LaunchConfiguration("namespace")), *nodes]),
            # A node that failed leaves the others without purpose; a replay that ended does not.
            *(
                RegisterEventHandler(OnProcessExit(target_action=node, on_exit=[EmitEvent(event=Shutdown())]))
                for node in (frontend, backend)
            ),
        ]
    )


def text(name):
    """Return an argument as a string, even where it looks like a number."""
    return ParameterValue(LaunchConfiguration(name), value_type=str)
