"""Messages: what goes in comes out, and the pose in /tf with the published points is the motion of the estimate."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("esfo_msgs.msg", reason="the messages are not built: make setup")

from esfo_msgs import msg
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header

from esfo_backend.ros import messages as backend
from esfo_bringup.replay import messages as replay
from esfo_core.activity import Activity, ActivityError
from esfo_core.activity_pyramid import BINS, ActivityPyramid
from esfo_core.camera import Camera
from esfo_core.codecs import decoder
from esfo_core.errors import EsfoError, TracksError
from esfo_core.estimate import Alternative, OrbitEstimate, RateEstimate
from esfo_core.events import make_events
from esfo_core.orbit import Spin, angle_between, rotation, tangent_basis
from esfo_core.packets import EVENT_PACKET, packet_from_cdr
from esfo_core.recordings.messages import camera_from_info
from esfo_core.tracks import Tracks, TrackUpdate
from esfo_frontend.frontend import FrontendOutput
from esfo_frontend.labelled_corners import LabelledCorners
from esfo_frontend.ros import messages as frontend
from esfo_ros.time_stamps import from_stamp, to_stamp

HEADER = Header(frame_id="camera")
AXIS = np.array([0.2, -0.9, 0.387])
SPIN = Spin(AXIS / np.linalg.norm(AXIS), 0.51, np.array([0.1, -0.05, 0.99]), 1_700_000_000_123_456_789)


def serialised(message):
    """The message as another process gets it."""
    return deserialize_message(serialize_message(message), type(message))


def some_estimate(points=40, **changes):
    rng = np.random.default_rng(3)
    values = {
        "status": "ok",
        "flags": ("scale_unobservable", "harmonic_ambiguous"),
        "reason": "",
        "spin": SPIN,
        "level": "orbit",
        "rate_hz": SPIN.rate_hz,
        "rate_std_hz": 2e-4,
        "stream_rate": RateEstimate(0.5001, 2e-4),
        "track_rate": RateEstimate(0.4999, 3e-4),
        "rate_slope_hz_s": -3e-3,
        "rate_slope_std_hz_s": 4e-4,
        "axis_cov": np.array([[2e-6, 3e-7], [3e-7, 1e-6]]),
        "points": rng.normal(0, 0.2, (points, 3)),
        "point_rms_px": rng.uniform(0.1, 2, points),
        "point_observations": rng.integers(3, 90, points),
        "tracks": 77,
        "observations": 1234,
        "revolutions": 2.04,
        "rms_px": 0.83,
        "initialisation": "direct",
        "t_first": SPIN.t0,
        "t_last": SPIN.t0 + 4_000_000_001,
        "alternatives": (
            Alternative("harmonic", 1.02, np.zeros(3), 1.04),
            Alternative("mirror", 0.51, np.array([0.6, 0.0, 0.8]), 1.9),
        ),
        "timing_s": {"spin_rate": 0.2, "graph": 1.5},
    }
    return OrbitEstimate(**{**values, **changes})


def assert_same(a, b, float32=()):
    for field in dataclasses.fields(a):
        x, y = getattr(a, field.name), getattr(b, field.name)
        if field.name in ("spin", "alternatives"):
            continue
        if field.name in float32:
            assert np.allclose(x, y, rtol=1e-6, atol=1e-6), field.name
        else:
            assert np.array_equal(x, y, equal_nan=isinstance(x, float | np.ndarray)), field.name
    for x, y in zip(a.alternatives, b.alternatives, strict=True):
        assert (x.kind, x.rate_hz, x.score_ratio) == (y.kind, y.rate_hz, y.score_ratio)
        assert np.array_equal(x.axis, y.axis)


def test_tracks_arrive_bit_for_bit():
    rng = np.random.default_rng(0)
    rows = Tracks.from_columns(
        rng.integers(0, 2**32, 500),
        rng.integers(0, 2**62, 500),
        rng.uniform(0, 640, (500, 2)),
        rng.uniform(0.2, 3, 500),
    )
    update = TrackUpdate(rows, np.array([7, 2**32 - 1], np.uint32))
    arrived = backend.update_from(serialised(frontend.tracks_message(update, HEADER)))
    for name in ("track_id", "t", "uv", "sigma"):
        assert getattr(arrived.observations, name).tobytes() == getattr(rows, name).tobytes()
    assert arrived.ended.tolist() == update.ended.tolist()
    empty = frontend.tracks_message(TrackUpdate(Tracks.empty(), np.empty(0, np.uint32)), HEADER)
    assert len(backend.update_from(serialised(empty)).observations) == 0


def test_malformed_tracks_are_refused():
    with pytest.raises(TracksError, match="unequal length"):
        backend.update_from(msg.FeatureTracks(track_id=[1, 2], t=[1], u=[1.0], v=[2.0], sigma=[1.0]))


def test_activity_arrives_in_pieces_that_join_to_the_whole():
    counts = np.random.default_rng(1).integers(0, 65536, (700, 2, 5, 8)).astype(np.uint16)
    activity = Activity(123_000_000, 5_000_000, 32, counts)
    sent = list(frontend.activity_messages(activity, 50, "camera"))
    assert len(sent) > 1
    parts = [backend.activity_from(serialised(m)) for m in sent]
    joined = Activity.concatenate(parts)
    assert (joined.t0, joined.bin, joined.cell) == (activity.t0, activity.bin, activity.cell)
    assert np.array_equal(joined.counts, counts)
    for message, part in zip(sent, parts, strict=True):
        assert replay.acknowledged_until(message) == part.end
        assert from_stamp(message.header.stamp) == part.end + 50


def test_pieces_of_a_pyramid_arrive_without_their_missing_bins():
    rng = np.random.default_rng(2)
    counts = rng.integers(0, 9, (3000, 2, 8, 10)).astype(np.uint16)
    valid = rng.random(3000) > 0.1
    piece = Activity(BINS[3] * 77, BINS[3], 16, counts, valid)
    output = FrontendOutput(
        LabelledCorners.concatenate([]), TrackUpdate(Tracks.empty(), np.empty(0, np.uint32)), None, (piece,)
    )
    pyramid = ActivityPyramid()
    pyramid.add(backend.activity_from(serialised(m)) for _, m in frontend.output_messages(output, 0, 50, "camera"))
    [level] = pyramid.levels()
    known = np.flatnonzero(valid)
    assert level.t0 == piece.t0 + piece.bin * known[0]
    inside = slice(known[0], known[-1] + 1)
    assert np.array_equal(level.valid, valid[inside])
    assert np.array_equal(level.counts, counts[inside] * valid[inside, None, None, None])


@pytest.mark.parametrize("changes", [{"rows": 0}, {"columns": 7}, {"bin": 0}])
def test_activity_that_does_not_fit_its_grid_is_refused(changes):
    good = {"t0": 0, "bin": 5, "cell": 32, "rows": 2, "columns": 2, "counts": [0] * 16}
    backend.activity_from(msg.EventActivity(**good))
    with pytest.raises(ActivityError, match="do not fit a grid"):
        backend.activity_from(msg.EventActivity(**{**good, **changes}))


def test_labelled_corners_keep_their_columns():
    corners = make_events([1, 2, 65535], [3, 4, 5], [0, 1, 1], [10, 20, 2**60])
    labelled = LabelledCorners.from_events(corners, np.array([-1, 5, 2**31 - 1]))
    arrived = serialised(frontend.corners_message(labelled, HEADER))
    for name in ("x", "y", "polarity", "t"):
        assert list(getattr(arrived, name)) == getattr(labelled, name).tolist()
    assert list(arrived.cluster_id) == labelled.label.tolist()


def test_packets_decode_to_the_events_they_were_made_of():
    rng = np.random.default_rng(2)
    t = 1_700_000_000_000_000_000 + np.sort(rng.integers(0, 2_000_000, 300))
    events = make_events(rng.integers(0, 346, 300), rng.integers(0, 260, 300), rng.integers(0, 2, 300), t)
    data = serialize_message(replay.packet_message(events, 41, (346, 260), "camera"))
    packet = packet_from_cdr(EVENT_PACKET, data)
    assert (packet.seq, packet.width, packet.height, packet.frame_id) == (41, 346, 260, "camera")
    assert packet.stamp == t[0]
    assert np.array_equal(decoder(packet.encoding, 346, 260).decode(packet.data, packet.time_base), events)


def test_camera_info_keeps_the_calibration():
    camera = Camera(
        346, 260, np.array([[200.5, 0, 170], [0, 201, 130], [0, 0, 1]]), "plumb_bob", np.array([0.1, -0.2, 0, 0])
    )
    arrived = camera_from_info(serialised(replay.camera_info_message(camera, "camera")))
    assert np.array_equal(arrived.K, camera.K)
    assert np.array_equal(arrived.D, camera.D)
    assert (arrived.width, arrived.height, arrived.distortion_model) == (346, 260, "plumb_bob")


def test_image_and_clock():
    rgb = np.random.default_rng(4).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    image = serialised(frontend.image_message(rgb, HEADER))
    assert (image.height, image.width, image.step, image.encoding) == (5, 7, 21, "rgb8")
    assert bytes(image.data) == rgb.tobytes()
    assert from_stamp(serialised(replay.clock_message(12_345_678_901)).clock) == 12_345_678_901


@pytest.mark.parametrize("ns", [-1, 2**31 * 10**9])
def test_a_time_that_ros_cannot_express_is_refused(ns):
    with pytest.raises(EsfoError, match=str(ns)):
        to_stamp(ns)


def test_an_estimate_survives_its_messages():
    estimate = some_estimate()
    orbit = serialised(backend.orbit_message(estimate, HEADER))
    cloud = serialised(backend.points_message(estimate, SPIN, Header(frame_id="object")))
    arrived = backend.estimate_from(orbit, cloud)
    assert_same(estimate, arrived, float32=("points", "point_rms_px"))
    assert arrived.spin.rate_hz == SPIN.rate_hz
    assert arrived.spin.t0 == SPIN.t0
    assert np.array_equal(arrived.spin.axis, SPIN.axis)
    assert np.array_equal(arrived.spin.center, SPIN.center)
    ours, theirs = estimate.to_json({}), backend.estimate_from(orbit, cloud).to_json({})
    assert ours == theirs
    assert orbit.phase == pytest.approx(float(SPIN.angle(np.asarray(estimate.t_last))) % (2 * np.pi))
    seen = frontend.spin_from(orbit)
    assert np.array_equal(seen.axis, SPIN.axis)


def test_a_failure_survives_its_messages():
    estimate = OrbitEstimate.failure("nothing turns", tracks=3, observations=9, t_last=5)
    orbit = serialised(backend.orbit_message(estimate, HEADER))
    assert_same(estimate, backend.estimate_from(orbit, None))
    assert backend.estimate_from(orbit, None).spin is None
    assert frontend.spin_from(orbit) is None
    assert len(backend.markers_message(None, HEADER).markers) == 1


def test_the_orbit_of_the_message_is_that_of_the_paper():
    orbit, paper = backend.orbit_message(some_estimate(), HEADER), SPIN.paper_orbit()
    x, y, z, w = orbit.r0
    R0 = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    assert np.allclose(R0, paper.R0, atol=1e-12)
    assert orbit.radius == paper.radius
    assert np.array_equal(orbit.n, paper.normal)
    assert np.array_equal(orbit.u, paper.u)
    assert np.array_equal(orbit.c, paper.c)


def test_an_axis_through_the_camera_has_no_orbit():
    through = dataclasses.replace(SPIN, center=2.0 * SPIN.axis)
    orbit = backend.orbit_message(some_estimate(spin=through, status="degenerate"), HEADER)
    assert orbit.radius == 0
    assert len(backend.markers_message(through, HEADER).markers) == 2


@pytest.mark.parametrize("seconds", [0.0, 0.3, 1.9, 987.6])
def test_pose_and_points_are_the_motion(seconds):
    t = SPIN.t0 + round(seconds * 1e9)
    estimate = some_estimate()
    cloud = np.frombuffer(backend.points_message(estimate, SPIN, HEADER).data, backend.POINT_DTYPE)
    X = np.stack([cloud["x"], cloud["y"], cloud["z"]], axis=1)
    transform = backend.transform_message(SPIN, t, HEADER, "object").transforms[0]
    assert (transform.header.frame_id, transform.child_frame_id) == ("camera", "object")
    q, p = transform.transform.rotation, transform.transform.translation
    imaginary, real = np.array([q.x, q.y, q.z]), q.w
    moved = X + 2 * np.cross(imaginary, np.cross(imaginary, X) + real * X) + [p.x, p.y, p.z]
    assert np.abs(moved - SPIN.transform(estimate.points, t)).max() < 1e-6  # float32 coordinates


def test_the_object_frame_has_its_z_axis_along_the_spin():
    transform = backend.transform_message(SPIN, SPIN.t0 + 77, HEADER, "object").transforms[0].transform.rotation
    imaginary, real = np.array([transform.x, transform.y, transform.z]), transform.w
    z = np.array([0.0, 0.0, 1.0])
    assert angle_between(z + 2 * np.cross(imaginary, np.cross(imaginary, z) + real * z), SPIN.axis) < 1e-6


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1.0, np.pi - 1e-9, np.pi, 3.5])
def test_quaternions_of_any_rotation(angle):
    for axis in (SPIN.axis, np.array([1.0, 0, 0]), np.array([0, 0, -1.0])):
        q = backend.quaternion(rotation(axis, angle))
        expected = np.array([*(np.sin(angle / 2) * axis), np.cos(angle / 2)])
        assert abs(abs(expected @ [q.x, q.y, q.z, q.w]) - 1) < 1e-12
        assert q.w >= 0


def test_the_twist_has_the_spin_and_its_covariance():
    estimate = some_estimate()
    twist = backend.twist_message(estimate, SPIN, HEADER).twist
    w = np.array([twist.twist.angular.x, twist.twist.angular.y, twist.twist.angular.z])
    assert np.allclose(w, 2 * np.pi * SPIN.rate_hz * SPIN.axis, rtol=1e-12)
    # Against draws of rate and axis from their distributions.
    rng, n = np.random.default_rng(6), 200_000
    rates = SPIN.rate_hz + estimate.rate_std_hz * rng.standard_normal(n)
    axes = SPIN.axis + rng.multivariate_normal([0, 0], estimate.axis_cov, n) @ tangent_basis(SPIN.axis).T
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    drawn = np.cov((2 * np.pi * rates[:, None] * axes).T)
    covariance = twist.covariance.reshape(6, 6)
    assert np.allclose(
        covariance[3:, 3:], drawn, atol=0.02 * np.abs(drawn).max()
    )  # 1/sqrt(n) of the draws, 5 times over
    assert not covariance[:3].any()
    assert np.allclose(covariance, covariance.T)


def test_markers_draw_the_axis_and_an_orbit_through_the_camera():
    clear, axis, orbit = backend.markers_message(SPIN, HEADER).markers
    assert clear.action == clear.DELETEALL
    ends = np.array([[p.x, p.y, p.z] for p in axis.points])
    assert np.allclose(ends.mean(axis=0), SPIN.center)
    assert angle_between(ends[1] - ends[0], SPIN.axis) < 1e-6
    circle = np.array([[p.x, p.y, p.z] for p in orbit.points])
    along = (circle - SPIN.center) @ SPIN.axis
    distance = np.linalg.norm(circle - SPIN.center - along[:, None] * SPIN.axis, axis=1)
    assert np.abs(circle[0]).max() < 1e-12  # the camera itself, at t0
    assert np.ptp(distance) < 1e-9
