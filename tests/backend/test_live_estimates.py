"""The back-end on a stream: how soon, how often, how good; and a stream that is interrupted and goes on."""

import numpy as np
import pytest
from scenes import CAMERA, NONE_ENDED, spin, tracks_of, unit

from esfo_backend.backend import Backend
from esfo_backend.errors import StateError
from esfo_backend.options import BackendOptions, LiveOptions, MemoryOptions, StartOptions
from esfo_core.activity import Activity
from esfo_core.orbit import angle_between
from esfo_core.simulation.activity import synthetic_activity
from esfo_core.tracks import TrackUpdate

AXIS = unit(0.3, -0.8, 0.4)
DIRECT = BackendOptions(start=StartOptions(method="direct"))
STEP_S = 0.1
BINS = 20


def stream(rate_hz, duration_s, points=60, outliers=0.1):
    """Tracks and activity of the whole, and both in steps of 0.1 s."""
    motion = spin(AXIS, rate_hz)
    scene = tracks_of(motion, points=points, noise_px=0.5, outliers=outliers, duration_s=duration_s)
    activity = synthetic_activity(motion, scene.points, CAMERA, duration_s)
    return scene, activity, [part(scene, activity, k) for k in range(round(duration_s / STEP_S))]


def part(scene, activity, k):
    bins = slice(BINS * k, BINS * (k + 1))
    piece = Activity(activity.t0 + BINS * k * activity.bin, activity.bin, activity.cell, activity.counts[bins])
    rows = (scene.tracks.t >= piece.t0) & (scene.tracks.t < piece.end)
    return TrackUpdate(scene.tracks.select(rows), NONE_ENDED), piece


@pytest.fixture(scope="module")
def half_hertz():
    return stream(0.5, 9.0)


@pytest.fixture(scope="module")
def backend_and_live(half_hertz):
    """A live back-end, and its estimates with the time in s at which each came."""
    backend, found = Backend(CAMERA, DIRECT), []
    for k, piece in enumerate(half_hertz[2]):
        estimate = backend.update(*piece)
        if estimate is not None:
            found.append((STEP_S * (k + 1), estimate))
    return backend, found


@pytest.fixture(scope="module")
def live(backend_and_live):
    return backend_and_live[1]


def test_the_first_estimate_comes_within_a_turn_and_two_seconds(live):
    assert next(t for t, e in live if e.status == "ok") <= 2.0 + 2.0


def test_a_fast_object_is_known_within_a_turn_and_two_seconds():
    backend = Backend(CAMERA, DIRECT)
    _, _, pieces = stream(2.0, 2.5)
    came = [STEP_S * (k + 1) for k, piece in enumerate(pieces) if (e := backend.update(*piece)) and e.status == "ok"]
    assert came
    assert came[0] <= 0.5 + 2.0


def test_then_one_comes_every_tenth_of_a_second(live):
    times = np.array([t for t, e in live if e.status == "ok"])
    np.testing.assert_allclose(np.diff(times), STEP_S, atol=1e-9)
    assert times[-1] == pytest.approx(9.0)


def test_stated_deviations_fall_and_are_honest(live):
    """That the error itself falls is shown over several scenes in test_follow: one has its luck."""
    good = [(t, e) for t, e in live if e.status == "ok"]
    early = [e for t, e in good if t < 4.5]
    late = [e for t, e in good if t > 8.0]
    assert late[-1].rate_std_hz < early[0].rate_std_hz / 2
    for _, e in good:
        assert abs(e.spin.rate_hz - 0.5) < 4 * e.rate_std_hz
        assert angle_between(e.spin.axis, AXIS) < 4 * e.axis_std_deg
    assert late[-1].revolutions == pytest.approx(4.5, rel=0.01)


def test_a_thorough_estimate_does_not_depend_on_live_ones(half_hertz, backend_and_live):
    scene, activity, _ = half_hertz
    quiet, (busy, _) = Backend(CAMERA, DIRECT), backend_and_live
    quiet.add(TrackUpdate(scene.tracks, NONE_ENDED), activity)
    a, b = quiet.solve(), busy.solve()
    assert a.spin.rate_hz == b.spin.rate_hz
    assert np.array_equal(a.points, b.points)


def test_a_saved_stream_goes_on_as_if_nothing_had_been(half_hertz, tmp_path):
    _, _, pieces = half_hertz
    small = MemoryOptions(max_bins=1000, max_rows=2000)
    for memory in (MemoryOptions(), small):
        options = BackendOptions(start=DIRECT.start, memory=memory, live=LiveOptions(interval_s=2.0, search_s=3.0))
        whole = Backend(CAMERA, options)
        for piece in pieces[:50]:
            whole.update(*piece)
        whole.save(tmp_path / "state.npz")
        resumed = Backend.load(tmp_path / "state.npz", options)
        assert resumed.camera.K.tolist() == CAMERA.K.tolist()
        assert resumed.counts() == whole.counts()
        for piece in pieces[50:]:
            whole.add(*piece)
            resumed.add(*piece)
        a, b = whole.solve(), resumed.solve()
        assert a.status == "ok", a.reason
        assert a.spin.rate_hz == b.spin.rate_hz
        assert (a.t_first, a.t_last, a.revolutions) == (b.t_first, b.t_last, b.revolutions)
        assert np.array_equal(a.points, b.points)


def test_an_empty_back_end_can_be_saved(tmp_path):
    Backend(CAMERA).save(tmp_path / "state.npz")
    assert "no events" in Backend.load(tmp_path / "state.npz").solve().reason


def test_files_that_are_no_state_are_named(tmp_path):
    path = tmp_path / "state.npz"
    with pytest.raises(StateError, match="No such file"):
        Backend.load(path)
    with pytest.raises(StateError, match="No such file"):
        Backend(CAMERA).save(tmp_path / "missing" / "state.npz")
    for content in (b"", b"orbit", b"PK\x03\x04" + 50 * b"x"):
        path.write_bytes(content)
        with pytest.raises(StateError, match=r"state\.npz"):
            Backend.load(path)
    Backend(CAMERA).save(path)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(StateError, match="not the state"):
        Backend.load(path)
    np.savez(path, version=99)
    with pytest.raises(StateError, match="version 99, this is version 1"):
        Backend.load(path)
    np.savez(path, version=1)
    with pytest.raises(StateError, match="damaged"):
        Backend.load(path)
    np.savez(path, points=np.zeros(3))
    with pytest.raises(StateError, match="version None"):
        Backend.load(path)
    np.savez(path, version=np.array([{}], dtype=object))
    with pytest.raises(StateError, match="not the state"):
        Backend.load(path)
