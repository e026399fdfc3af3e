"""The nodes as processes over DDS: the same tracks and the same orbit as without ROS, nothing lost, and clean ends."""

import signal
import subprocess

import numpy as np
import pytest

pytest.importorskip("esfo_msgs.msg", reason="the messages are not built: make setup")

import spinning_squares
from diagnostic_msgs.msg import DiagnosticArray
from esfo_msgs import msg
from geometry_msgs.msg import TwistWithCovarianceStamped
from graph import BACKEND, FRONTEND, REPLAY, executable
from listener import LATCHED, PATIENCE_S
from sensor_msgs.msg import Image, PointCloud2
from tf2_msgs.msg import TFMessage

from esfo_backend.backend import Backend
from esfo_backend.ros.messages import estimate_from, update_from
from esfo_core.camera import Camera
from esfo_core.orbit import angle_between
from esfo_core.recordings import open_recording
from esfo_core.tracks import Tracks
from esfo_frontend.frontend import Frontend

REPLAYED = ["-p", "use_sim_time:=true", "-p", "wait_for_back_end:=true", "-p", "events.reliability:=reliable"]


def offline(path):
    recording = open_recording(path)
    frontend, backend = Frontend(recording), Backend(recording.camera)
    outputs = [frontend.process(chunk) for chunk in recording.chunks()]
    for output in [*outputs, frontend.flush()]:
        backend.add(output.tracks, output.activity, output.pyramid)
        yield output.tracks.observations
    yield backend.solve()


def test_live_and_offline_give_the_same(recording, listener, start):
    listener.listen(msg.FeatureTracks, "feature_tracks")
    listener.listen(msg.OrbitEstimate, "orbit", LATCHED)
    listener.listen(PointCloud2, "points", LATCHED)
    listener.listen(TwistWithCovarianceStamped, "spin_rate", LATCHED)
    listener.listen(TFMessage, "/tf", 1000)
    listener.listen(DiagnosticArray, "/diagnostics")
    listener.listen(Image, "overlay", 1)
    start(executable(*BACKEND), "--ros-args", "-p", "use_sim_time:=true")
    # Tracks go to the back-end and to this test, activity to the back-end and to the replay.
    start(executable(*FRONTEND), "--ros-args", *REPLAYED, "-p", "min_listeners:=2")
    replay = start(executable(*REPLAY), "--ros-args", "-p", f"recording:={recording}", "-p", "rate:=0")
    listener.until(lambda: replay.poll() is not None)
    assert replay.returncode == 0

    flushed = listener.call("/frontend/flush")
    solved = listener.call("/backend/solve")
    for _ in range(10):  # the last messages may still be under way, as `esfo live` takes into account
        if solved["activity_bins"] == flushed["activity_bins"]:
            break
        solved = listener.call("/backend/solve")
    *parts, expected = offline(recording)
    tracks = Tracks.concatenate(parts)
    assert int(flushed["observations"]) == int(solved["observations"]) == len(tracks) > 100
    assert flushed["activity_bins"] == solved["activity_bins"]
    assert int(flushed["packets"]) == int(replay.stdout.read().split("published ")[1].split()[0])

    listener.until(lambda: sum(len(m.t) for m in listener.got["feature_tracks"]) == len(tracks))
    live = Tracks.concatenate(update_from(m).observations for m in listener.got["feature_tracks"])
    for name in ("track_id", "t", "uv", "sigma"):
        assert getattr(live, name).tobytes() == getattr(tracks, name).tobytes(), name

    estimate = estimate_from(listener.got["orbit"][-1], listener.got["points"][-1])
    assert estimate.status == expected.status == solved["status"] == "ok"
    assert estimate.spin.rate_hz == pytest.approx(expected.spin.rate_hz, rel=1e-9)
    assert angle_between(estimate.spin.axis, expected.spin.axis) < 1e-6
    assert estimate.points == pytest.approx(expected.points, abs=1e-5)
    truth = spinning_squares.SPIN
    assert abs(estimate.spin.rate_hz - truth.rate_hz) < 0.005 * truth.rate_hz
    assert angle_between(estimate.spin.axis, truth.axis) < 1.0

    twist = listener.got["spin_rate"][-1].twist.twist.angular
    assert np.hypot(np.hypot(twist.x, twist.y), twist.z) == pytest.approx(2 * np.pi * estimate.spin.rate_hz)
    assert listener.got["/tf"][-1].transforms[0].child_frame_id == "object"
    assert listener.got["overlay"][-1].width == 240
    listener.until(lambda: len({m.status[0].name for m in listener.got["/diagnostics"]}) == 2)
    assert {m.status[0].message for m in listener.got["/diagnostics"]} <= {"ok", "no camera_info yet"}


def test_late_listeners_get_the_latest_estimate_and_sigterm_ends_a_node(listener, start):
    node = start(executable(*BACKEND))
    assert listener.call("/backend/solve")["status"] == "failed"
    listener.listen(msg.OrbitEstimate, "orbit", LATCHED)
    listener.until(lambda: listener.got["orbit"])
    assert listener.got["orbit"][0].reason == "no camera_info received"
    node.send_signal(signal.SIGTERM)
    output, _ = node.communicate(timeout=PATIENCE_S)
    assert node.returncode == 0, output
    assert "Traceback" not in output


WRONG = {
    "no such file": (REPLAY, ["recording:={tmp}/none"], "none: No such file"),
    "empty file": (REPLAY, ["recording:={tmp}/empty.mcap"], "empty.mcap"),
    "camera of another size": (REPLAY, ["recording:={rec}", "camera:={tmp}/other.yaml"], "is of 10x10 px"),
    "NaN intrinsics": (REPLAY, ["recording:={rec}", "camera:={tmp}/nan.yaml"], "not 3x3 of finite numbers"),
    "nobody listens": (REPLAY, ["recording:={rec}", "wait_timeout_s:=0.5"], "0 of 1 subscribers of /events"),
    "unknown preset": (FRONTEND, ["preset:=best"], "preset is 'best'; choose from default, paper"),
    "out of range": (BACKEND, ["initialisation.cauchy_px:=-1.0"], "initialisation.cauchy_px"),
    "fraction of a count": (
        BACKEND,
        ["initialisation.axes:=24.5"],
        "parameter initialisation.axes takes int, got 24.5",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_input_is_one_line_and_exit_code_1(case, recording, ros_domain, tmp_path):
    command, parameters, says = WRONG[case]
    (tmp_path / "empty.mcap").write_bytes(b"")
    Camera.pinhole(10, 10, 9.0).write_yaml(tmp_path / "other.yaml")
    (tmp_path / "nan.yaml").write_text((tmp_path / "other.yaml").read_text().replace("9.0", ".nan", 1))
    arguments = [word for p in parameters for word in ("-p", p.format(tmp=tmp_path, rec=recording))]
    done = subprocess.run(
        [executable(*command), "--ros-args", *arguments],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    errors = [line for line in done.stderr.splitlines() if not line.startswith("[INFO]")]
    assert done.returncode == 1, done.stderr
    assert len(errors) == 1, done.stderr
    assert says in errors[0]
