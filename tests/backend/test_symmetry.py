"""Objects that look the same after part of a turn: the tracks know the turn, the flag says that the stream does not."""

import dataclasses

import numpy as np
import pytest
from scenes import CAMERA, NONE_ENDED, spin, tracks_of, unit

from esfo_backend.backend import Backend
from esfo_backend.options import BackendOptions, InitialisationOptions
from esfo_backend.spin_rate.correlation import correlation_rate
from esfo_core.orbit import angle_between, rotation
from esfo_core.tracks import Tracks, TrackUpdate
from esfo_simulation.activity import synthetic_activity

AXIS = unit(0.3, -0.8, 0.4)
RATE, PERIOD_S = 0.5, 2.0


def symmetric(axis, fold, duration_s=4.0, unlike=0):
    """Return tracks and activity of a ball that looks the same after 1 / fold turns, but for `unlike` points.

    A point that is 1 / fold turns ahead is seen at t as its copy was at t + period / fold.
    """
    motion = spin(axis, RATE)
    begin, end = motion.t0, motion.t0 + int(duration_s * 1e9)
    rng = np.random.default_rng(0)
    tracks, points, last = [], [], 0
    for k, count in [(k, max(60 // fold, 3)) for k in range(fold)] + [(0, unlike)] * (unlike > 0):
        earlier = dataclasses.replace(motion, t0=motion.t0 - round(k * PERIOD_S / fold * 1e9))
        part = tracks_of(earlier, points=count, duration_s=duration_s + PERIOD_S, seed=int(count == unlike))
        rows = part.tracks.select((part.tracks.t >= begin) & (part.tracks.t < end))
        uv = rows.uv + rng.normal(0, 0.5, rows.uv.shape)
        tracks.append(Tracks(rows.track_id + np.uint32(last), rows.t, uv.astype(np.float32), rows.sigma + 0.5))
        points.append(part.points @ rotation(axis, 2 * np.pi * k / fold).T)
        last += len(part.point_of_track)
    activity = synthetic_activity(motion, np.concatenate(points), CAMERA, duration_s)
    counts = activity.counts.copy()  # polarities are drawn for each point, which would tell the copies apart
    counts[:, 0] += counts[:, 1]
    counts[:, 1] = 0
    return Tracks.concatenate(tracks), dataclasses.replace(activity, counts=counts)


def solved(tracks, activity):
    backend = Backend(CAMERA, BackendOptions(initialisation=InitialisationOptions(method="direct")))
    backend.add(TrackUpdate(tracks, NONE_ENDED), activity)
    return backend.solve()


@pytest.mark.parametrize("axis", [AXIS, -AXIS], ids=["one sense", "the other"])
@pytest.mark.parametrize("fold", [2, 4, 12])
def test_the_tracks_tell_the_turn_of_a_symmetric_object(fold, axis):
    tracks, activity = symmetric(axis, fold)
    of_stream = correlation_rate(activity, BackendOptions().rate).rate_hz
    assert of_stream / RATE == pytest.approx(round(of_stream / RATE), abs=0.01)
    estimate = solved(tracks, activity)
    assert estimate.status == "ok", estimate.reason
    assert "harmonic_ambiguous" in estimate.flags
    assert abs(estimate.spin.rate_hz - RATE) < 3.5 * estimate.rate_std_hz
    assert angle_between(estimate.spin.axis, axis) < 3.5 * estimate.axis_std_deg
    assert estimate.rate_std_hz < 1e-4
    assert any(a.kind == "harmonic" and abs(a.rate_hz - fold * RATE) < 0.01 for a in estimate.alternatives)


@pytest.mark.parametrize("fold", [2, 4, 12])
def test_a_few_points_that_differ_tell_it_too(fold):
    estimate = solved(*symmetric(AXIS, fold, unlike=6))
    assert estimate.status == "ok", estimate.reason
    assert abs(estimate.spin.rate_hz - RATE) < 3.5 * estimate.rate_std_hz
