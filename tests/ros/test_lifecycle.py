"""The nodes as citizens of a ROS graph: life cycle, live parameters, namespaces, quality of service, lost packets."""

import time

import numpy as np
import pytest

pytest.importorskip("esfo_msgs.msg", reason="the messages are not built: make setup")

import dvs_msgs.msg
import prophesee_event_msgs.msg
import spinning_squares
from camera_driver import CameraDriver, camera_info
from esfo_msgs import msg
from graph import BACKEND, FRONTEND, REPLAY, executable
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from listener import LATCHED
from rcl_interfaces.srv import DescribeParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from esfo_core.orbit import angle_between
from esfo_core.recordings import write_mcap
from esfo_ros.time_stamps import to_stamp

CONFIGURE, CLEANUP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
BY_HAND = ["--ros-args", "-p", "autostart:=false"]
REPLAYED = ["-p", "wait_for_back_end:=true", "-p", "events.reliability:=reliable"]


def warned(listener, node, text):
    status = listener.health(node)
    return status is not None and status.level == b"\x01" and text in status.message


def well(listener, node):
    status = listener.health(node)
    return status is not None and status.level == b"\x00"


def connected_camera(listener):
    """A camera whose events are taken; what is sent right after the discovery may not arrive."""
    camera = CameraDriver(listener.node)
    listener.until(lambda: camera.listeners)
    listener.spin(0.5)
    return camera


def flushed(listener, packets):
    """What the front-end says when it has had so many packets; on a busy machine some may still be on the way."""
    answers = []

    def complete():
        answers.append(listener.call("/frontend/flush"))
        return int(answers[-1]["packets"]) >= packets

    listener.until(complete)
    assert int(answers[-1]["packets"]) == packets
    return answers[-1]


def solved(listener):
    return [orbit for orbit in listener.got["orbit"] if orbit.status == msg.OrbitEstimate.STATUS_OK]


def test_the_life_cycle_is_walked_through_twice(recording, listener, start):
    listener.listen(msg.OrbitEstimate, "orbit", LATCHED)
    start(executable(*BACKEND), *BY_HAND)
    start(executable(*FRONTEND), *BY_HAND, *REPLAYED)
    found = []
    for _ in range(2):
        for node in ("/backend", "/frontend"):
            assert listener.state(node) == "unconfigured"
            assert listener.change_state(node, CONFIGURE) == "inactive"
            assert listener.change_state(node, ACTIVATE) == "active"
        replay = start(executable(*REPLAY), "--ros-args", "-p", f"recording:={recording}", "-p", "rate:=0")
        listener.until(lambda replay=replay: replay.poll() is not None)
        listener.call("/frontend/flush")
        answer = listener.call("/backend/solve")
        assert answer["status"] == "ok"
        listener.until(lambda: solved(listener))
        found.append((int(answer["observations"]), solved(listener)[-1]))
        for node in ("/backend", "/frontend"):
            assert listener.change_state(node, DEACTIVATE) == "inactive"
        # What was learnt is kept while the nodes are inactive.
        assert listener.call("/backend/solve")["observations"] == answer["observations"]
        for node in ("/backend", "/frontend"):
            assert listener.change_state(node, CLEANUP) == "unconfigured"
        listener.got["orbit"].clear()
    (rows, first), (rows_again, second) = found
    assert rows == rows_again > 100
    assert second.rate_hz == pytest.approx(first.rate_hz, rel=1e-9)
    assert angle_between(np.array(first.axis), spinning_squares.SPIN.axis) < 1.0


def test_a_failed_configuration_says_why_and_can_be_mended(listener, start, tmp_path):
    node = start(executable(*BACKEND), *BY_HAND, "-p", f"resume:={tmp_path}/none.npz")
    request = ChangeState.Request(transition=Transition(id=CONFIGURE))
    answer = listener.ask(ChangeState, "/backend/change_state", request)
    assert not answer.success
    assert listener.state("/backend") == "unconfigured"
    assert listener.set_parameter("/backend", "resume", "") == ""
    assert listener.change_state("/backend", CONFIGURE) == "inactive"
    node.terminate()
    output, _ = node.communicate(timeout=30)
    assert "none.npz: No such file" in output


def test_late_listeners_get_the_orbit_and_it_can_be_saved_and_gone_on_from(recording, listener, start, tmp_path):
    start(executable(*BACKEND), "--ros-args", "-p", f"save_folder:={tmp_path}/saved")
    start(executable(*FRONTEND), "--ros-args", *REPLAYED)
    replay = start(executable(*REPLAY), "--ros-args", "-p", f"recording:={recording}", "-p", "rate:=0")
    listener.until(lambda: replay.poll() is not None)
    listener.call("/frontend/flush")
    assert listener.call("/backend/solve")["status"] == "ok"
    listener.listen(msg.OrbitEstimate, "orbit", LATCHED)
    listener.listen(PointCloud2, "points", LATCHED)
    listener.until(lambda: solved(listener) and listener.got["points"])
    orbit = listener.got["orbit"][-1]
    assert listener.got["points"][-1].width == orbit.points > 10

    folder = listener.ask(Trigger, "/backend/save", Trigger.Request())
    assert folder.success, folder.message
    (made,) = (tmp_path / "saved").iterdir()
    assert folder.message == str(made)
    assert {p.name for p in made.iterdir()} == {"orbit.json", "points.ply", "tracks.csv", "state.npz"}

    listener.call("/backend/reset")
    listener.until(lambda: listener.got["orbit"][-1].reason == "reset")
    start(executable(*BACKEND), "--ros-args", "-r", "__node:=second", "-p", f"resume:={made}/state.npz")
    listener.got["orbit"].clear()
    assert listener.call("/second/solve")["status"] == "ok"
    listener.until(lambda: solved(listener))
    again = solved(listener)[-1]
    assert abs(again.rate_hz - orbit.rate_hz) < 3 * orbit.rate_std_hz


def test_two_pipelines_in_namespaces_do_not_mix(recording, listener, start, tmp_path):
    mirrored = tmp_path / "mirrored.mcap"
    width = spinning_squares.CAMERA.width

    def flipped():
        for events in spinning_squares.events(1.9):
            copy = events.copy()
            copy["x"] = width - 1 - copy["x"]
            yield copy

    write_mcap(mirrored, flipped(), spinning_squares.CAMERA)
    scenes = {"left": recording, "right": mirrored}
    replays = {}
    for name, path in scenes.items():
        inside = ["--ros-args", "-r", f"__ns:=/{name}"]
        start(executable(*BACKEND), *inside, "-p", f"object_frame:={name}_object")
        start(executable(*FRONTEND), *inside, *REPLAYED)
        replays[name] = start(executable(*REPLAY), *inside, "-p", f"recording:={path}", "-p", "rate:=0")
        listener.listen(msg.OrbitEstimate, f"/{name}/orbit", LATCHED)
    axes = {}
    for name in scenes:
        listener.until(lambda name=name: replays[name].poll() is not None)
        flushed = listener.call(f"/{name}/frontend/flush")
        answer = listener.call(f"/{name}/backend/solve")
        assert answer["observations"] == flushed["observations"]
        assert answer["status"] == "ok"
        listener.until(lambda name=name: listener.got[f"/{name}/orbit"][-1].status == msg.OrbitEstimate.STATUS_OK)
        axes[name] = np.array(listener.got[f"/{name}/orbit"][-1].axis)
    # A mirror turns the spin about: the axis is a pseudovector, of which the image's x keeps its sign.
    truth = spinning_squares.SPIN.axis
    assert angle_between(axes["left"], truth) < 1.0
    assert angle_between(axes["right"], truth * [1, -1, -1]) < 1.0


def test_parameters_change_live_or_are_refused(listener, start):
    start(executable(*BACKEND), "--ros-args")
    start(executable(*FRONTEND), "--ros-args")
    listener.until(lambda: well(listener, "/frontend"))
    tracks = listener.listen(msg.FeatureTracks, "feature_tracks")
    camera = connected_camera(listener)
    stream = list(spinning_squares.events(0.9))
    camera.send(stream[:300])
    listener.until(lambda: tracks)
    rows = int(flushed(listener, 300)["observations"])
    assert rows > 0
    last_id = max(max(m.track_id, default=0) for m in tracks)

    refused = {
        ("association.gate", -1.0): "range",
        ("tracker", "magic"): "choose from association, clusters",
        ("clusters.shared", 100.0): "more than half of clusters.chunk",
        ("queue", "long"): "takes int",
        ("preset", "paper"): "read-only",
    }
    for (name, value), why in refused.items():
        assert why in listener.set_parameter("/frontend", name, value)
    # Nothing is a corner track any more that has fewer corners than there are.
    assert listener.set_parameter("/frontend", "association.first_corners", 10_000) == ""
    camera.send(stream[300:600])
    assert int(flushed(listener, 600)["observations"]) == rows
    assert listener.set_parameter("/frontend", "association.first_corners", 10) == ""
    tracks.clear()
    camera.send(stream[600:])
    assert int(flushed(listener, len(stream))["observations"]) > rows
    listener.until(lambda: tracks)
    assert min(min(m.track_id, default=last_id + 1) for m in tracks) > last_id, "an id was used again"


def test_parameters_describe_themselves(listener, start):
    start(executable(*BACKEND), *BY_HAND)
    names = ["initialisation.cauchy_px", "rate.method", "autostart"]
    answer = listener.ask(DescribeParameters, "/backend/describe_parameters", DescribeParameters.Request(names=names))
    cauchy, method, autostart = answer.descriptors
    assert "px" in cauchy.description
    assert cauchy.floating_point_range[0].from_value == 0.1
    assert not cauchy.read_only
    assert method.additional_constraints == "one of: correlation, fourier"
    assert autostart.read_only


def test_lost_and_unreadable_packets_turn_diagnostics_to_warn_and_back(listener, start):
    start(executable(*FRONTEND), "--ros-args")
    listener.until(lambda: well(listener, "/frontend"))
    camera = connected_camera(listener)
    stream = list(spinning_squares.events(0.3))
    camera.send(stream[:100])
    listener.until(lambda: well(listener, "/frontend"))
    camera.send(stream[107:200], skip=7)
    listener.until(lambda: warned(listener, "/frontend", "7 packets lost"))
    listener.until(lambda: well(listener, "/frontend"))
    camera.send_garbage()
    listener.until(lambda: warned(listener, "/frontend", "morse"))
    camera.send(stream[200:])
    listener.until(lambda: well(listener, "/frontend"))
    flushed(listener, len(stream) - 7)
    values = listener.values("/frontend")
    assert (values["lost"], values["unreadable"]) == ("7", "1")


@pytest.mark.parametrize("offered", ["reliable", "best_effort"])
def test_a_publisher_of_either_reliability_and_the_remedy_for_a_mismatch(offered, listener, start):
    start(executable(*FRONTEND), "--ros-args", "-p", "events.reliability:=reliable")
    listener.until(lambda: well(listener, "/frontend"))
    camera = CameraDriver(listener.node, reliability=offered)
    if offered == "best_effort":
        listener.until(lambda: warned(listener, "/frontend", "set events.reliability:=best_effort"))
        assert camera.listeners == 0
        assert listener.set_parameter("/frontend", "events.reliability", "best_effort") == ""
    listener.until(lambda: camera.listeners)
    listener.until(lambda: well(listener, "/frontend"))
    listener.spin(0.5)
    for events in spinning_squares.events(0.1):
        camera.send([events])
        listener.spin(0.005)
    assert int(listener.call("/frontend/flush")["packets"]) > 90


def test_a_recording_that_begins_again_begins_anew(listener, start):
    start(executable(*BACKEND), "--ros-args", "-p", "idle_solve_s:=0.0")
    start(executable(*FRONTEND), "--ros-args", "-p", "events.reliability:=reliable", "-p", "wait_for_back_end:=true")
    listener.listen(msg.OrbitEstimate, "orbit", LATCHED)
    camera = connected_camera(listener)
    stream = list(spinning_squares.events(1.9))
    rates = []
    for turn in (1, 2):
        for events in stream:
            camera.send([events])
            time.sleep(0.0005)
        flushed(listener, turn * len(stream))
        answer = listener.call("/backend/solve")
        assert answer["status"] == "ok"
        listener.until(lambda: solved(listener))
        rates.append(solved(listener)[-1])
        listener.got["orbit"].clear()
    first, second = rates
    assert second.t_first == first.t_first, "the second time around was added to the first"
    assert abs(second.rate_hz - spinning_squares.SPIN.rate_hz) < 0.005
    listener.until(lambda: well(listener, "/frontend"))


def test_an_inactive_node_takes_nothing_and_loses_nothing(listener, start):
    start(executable(*FRONTEND), "--ros-args")
    listener.until(lambda: well(listener, "/frontend"))
    camera = connected_camera(listener)
    stream = list(spinning_squares.events(0.3))
    camera.send(stream[:100])
    flushed(listener, 100)
    assert listener.change_state("/frontend", DEACTIVATE) == "inactive"
    listener.until(lambda: not camera.listeners)
    camera.send(stream[100:200])
    flushed(listener, 100)
    assert listener.change_state("/frontend", ACTIVATE) == "active"
    listener.until(lambda: camera.listeners)
    listener.spin(0.5)
    camera.send(stream[200:])
    flushed(listener, len(stream) - 100)
    assert listener.values("/frontend")["lost"] == "0"


@pytest.mark.parametrize("kind", [dvs_msgs.msg, prophesee_event_msgs.msg])
def test_arrays_of_events_are_taken_as_they_are_published(kind, listener, start):
    start(executable(*FRONTEND), "--ros-args", "-p", "events.reliability:=reliable")
    listener.until(lambda: well(listener, "/frontend"))
    publisher = listener.node.create_publisher(kind.EventArray, "events", 1000)
    listener.until(publisher.get_subscription_count)
    listener.spin(0.5)
    stream = list(spinning_squares.events(0.2))
    for events in stream:
        message = kind.EventArray(width=spinning_squares.CAMERA.width, height=spinning_squares.CAMERA.height)
        message.header = Header(stamp=to_stamp(int(events["t"][0])), frame_id="camera")
        message.events = [
            kind.Event(x=int(x), y=int(y), ts=to_stamp(int(t)), polarity=bool(p)) for x, y, p, t in events
        ]
        publisher.publish(message)
    assert int(flushed(listener, len(stream))["observations"]) > 0
    assert int(listener.values("/frontend")["events"]) == sum(len(events) for events in stream)


def test_events_of_an_unknown_type_are_named(listener, start):
    start(executable(*FRONTEND))
    listener.until(lambda: well(listener, "/frontend"))
    publisher = listener.node.create_publisher(PointCloud2, "events", 10)
    listener.until(lambda: warned(listener, "/frontend", "events are sensor_msgs/msg/PointCloud2; known: event_camera"))
    listener.node.destroy_publisher(publisher)
    listener.until(lambda: well(listener, "/frontend"))


@pytest.mark.parametrize("durability", [DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE])
def test_a_calibration_is_taken_from_publishers_that_latch_and_that_do_not(durability, listener, start):
    start(executable(*BACKEND))
    publisher = listener.node.create_publisher(CameraInfo, "camera_info", QoSProfile(depth=1, durability=durability))
    listener.until(lambda: warned(listener, "/backend", "no camera_info yet"))
    listener.until(publisher.get_subscription_count)
    publisher.publish(camera_info())
    listener.until(lambda: well(listener, "/backend"))


def test_quality_of_service_can_be_overridden_and_a_mismatch_with_a_listener_is_named(listener, start):
    start(executable(*BACKEND), "--ros-args", "-p", "qos_overrides./points.publisher.reliability:=best_effort")
    listener.listen(PointCloud2, "points", 10)
    says = "points does not reach listener: the publisher is best effort, the subscription requests reliable"
    listener.until(lambda: warned(listener, "/backend", says))
