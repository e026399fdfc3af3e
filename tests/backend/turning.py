"""Events of a turning body, and of other things that move, by drawing them at random: no camera is simulated."""

from __future__ import annotations

import numpy as np

from esfo_core.activity_pyramid import ActivityPyramid
from esfo_core.events import make_events
from esfo_core.pyramid_counter import PyramidCounter

SIZE = (240, 180)
_ANGLES = 720


def turning_events(rate_hz, turns, seed=0, *, points=40, events=4000, radius=60.0, fold=1, size=SIZE, start=10**9):
    """`events` a turn of points on a tilted cylinder, on its front; `fold`: so many times symmetric about its axis."""
    rng = np.random.default_rng(seed)
    x, y, visible, polarity = _tracks(rng, points, radius, fold, size)
    weight = np.where(visible, np.hypot(np.gradient(x, axis=1), np.gradient(y, axis=1)), 0.0).ravel()
    cumulative = np.cumsum(weight) / weight.sum()
    n = rng.poisson(events * turns)
    at = np.searchsorted(cumulative, rng.random(n))
    turn = rng.integers(0, int(np.ceil(turns)), n) + (at % _ANGLES + rng.random(n)) / _ANGLES
    kept = turn < turns
    at, turn = at[kept], turn[kept]
    u, v = (a.ravel()[at] + rng.normal(0, 0.7, len(at)) for a in (x, y))
    return packed(u, v, polarity[at // _ANGLES], start + turn / rate_hz * 1e9, size)


def _tracks(rng, points, radius, fold, size):
    phase, height = rng.uniform(0, 2 * np.pi / fold, points), rng.uniform(-0.7, 0.7, points) * radius
    phase = (phase + 2 * np.pi / fold * np.arange(fold)[:, None]).ravel()
    theta = phase[:, None] + np.linspace(0, 2 * np.pi, _ANGLES, endpoint=False)
    x = size[0] / 2 + radius * np.cos(theta)
    y = size[1] / 2 + np.tile(height, fold)[:, None] + 0.3 * radius * np.sin(theta)
    return x, y, np.sin(theta) < 0, np.tile(rng.integers(0, 2, points), fold)


def noise_events(duration_s, count, seed=0, size=SIZE, start=10**9):
    """Events anywhere at any time."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, size[0], count), rng.uniform(0, size[1], count)
    return packed(x, y, rng.integers(0, 2, count), start + rng.uniform(0, duration_s, count) * 1e9, size)


def flicker_events(duration_s, rate_hz, count, seed=0, size=SIZE, start=10**9):
    """Events of all pixels: on as the light grows, off as it fades."""
    rng = np.random.default_rng(seed)
    period = rng.integers(0, int(duration_s * rate_hz), count)
    polarity = rng.integers(0, 2, count)
    phase = np.where(polarity, 0.25, 0.75) + rng.normal(0, 0.08, count)
    x, y = rng.uniform(0, size[0], count), rng.uniform(0, size[1], count)
    return packed(x, y, polarity, start + (period + phase) / rate_hz * 1e9, size)


def wandering_events(duration_s, count, seed=0, points=30, size=SIZE, start=10**9):
    """Events of points each of which wanders at random."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0, 1, count))
    who = rng.integers(0, points, count)
    steps = rng.normal(0, 1, (2, points, 400)).cumsum(axis=2)
    place = steps * 4 + np.array(size)[:, None, None] / 2
    at = t * 399
    u, v = (np.interp(at + 400 * who, np.arange(400 * points), p.ravel()) for p in place)
    return packed(u, v, who % 2, start + t * duration_s * 1e9, size)


def packed(x, y, polarity, t, size):
    """Events inside of the sensor, in order of time."""
    order = np.argsort(t, kind="stable")
    x, y, polarity, t = (np.asarray(a)[order] for a in (x, y, polarity, t))
    inside = (x >= 0) & (x < size[0]) & (y >= 0) & (y < size[1])
    return make_events(x[inside], y[inside], polarity[inside], t[inside])


def merged(*parts):
    """Several streams of events as one."""
    events = np.concatenate(parts)
    return events[np.argsort(events["t"], kind="stable")]


def levels_of(events, size=SIZE, lost=()):
    """Levels of the pyramid of events; lost: (begin, end) ns of packets known to be lost, in order."""
    counter, pyramid = PyramidCounter(*size), ActivityPyramid()
    for begin, end in lost:
        split = np.searchsorted(events["t"], [begin, end])
        counter.add(events[: split[0]])
        counter.miss(begin, end)
        events = events[split[1] :]
    for part in np.array_split(events, max(len(events) // 50_000, 1)):
        counter.add(part)
        pyramid.add(counter.take())
    counter.finish()
    pyramid.add(counter.take())
    return pyramid.levels()
