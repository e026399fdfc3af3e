"""All pixels of an event sensor through one step between two frames.

A pixel is computed only when it may fire: its state is that of the time SINCE, after which it had no event. The test
whether it may is on integers: whether its level leaves a band.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_simulation.sensor.pixel import BLIND, LEAK, OFF, ON, REFERENCE, SIGNAL, SINCE, cut, follow_step, shoot

Column = NDArray[np.float64]
State = NDArray[np.float64]
Band = NDArray[np.int32]
Rows = NDArray[np.int64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

_FAR = 2.0**30
_SETTLED = 1e-9
"""Distance from its input, log intensity, at which a photoreceptor counts as having arrived."""


class Response(NamedTuple):
    """What pixels have in common.

    tau: time constant of each level, (65536,) ns, or none, (0,), where photoreceptors follow at once. white: brightest
    log intensity. refractory: dead time, ns.
    """

    tau: Column
    white: float
    refractory: float


class Exposure(NamedTuple):
    """Light on N pixels in one step: level k is a log intensity of low + k step.

    before, after: (N,) levels at both ends. borders: (S + 1,) times in ns that cut the step into parts; flicker:
    (S + 1,) what the illumination adds there, log intensity, linear between them; margin: its least and greatest in
    levels, rounded away from 0. valid: ns, to which bands hold. response: of the pixels.
    """

    before: NDArray[np.uint16]
    after: NDArray[np.uint16]
    low: float
    step: float
    borders: Column
    flicker: Column
    margin: tuple[int, int]
    valid: float
    response: Response


class Shots(NamedTuple):
    """Candidates of shot noise (M,), sorted by pixel and time.

    pixel: index. time: ns. polarity: 0 or 1. level: 0..1, what the rate relative to the dark must exceed.
    """

    pixel: NDArray[np.int64]
    time: Column
    polarity: NDArray[np.int64]
    level: Column


@njit(cache=True, nogil=True, error_model="numpy")
def follow_shots(
    state: State, i: int, light: tuple[float, float, float], exposure: Exposure, shots: Shots, out: Rows
) -> Rows:
    """Carry pixel i through a step with shots, all its own. light: as in `follow_step`."""
    before, after, tau = light
    begin, end = exposure.borders[0], exposure.borders[-1]
    white, refractory = exposure.response.white, exposure.response.refractory
    slope = (after - before) / (end - begin)
    start = begin
    for k in range(len(shots.time) + 1):
        stop = shots.time[k] if k < len(shots.time) else end
        if stop > start:
            part = (before + slope * (start - begin), before + slope * (stop - begin), tau)
            lamp = cut((exposure.borders, exposure.flicker), start, stop)
            out = follow_step(state, i, part, lamp, refractory, out)
            start = stop
        if k < len(shots.time):
            out = shoot(state, i, (stop, shots.polarity[k], shots.level[k]), white, refractory, out)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def find_band(state: State, band: Band, i: int, scale: tuple[float, float], valid: float) -> None:
    """Set the levels band[0, i]..band[1, i] in which pixel i makes no event up to time `valid`, ns.

    scale: level k is a log intensity of scale[0] + k scale[1]. One level less on either side, against rounding.
    """
    low, step = scale
    reference = state[i, REFERENCE]
    leaked = state[i, LEAK] * (valid - state[i, SINCE])
    band[0, i] = int(max(np.ceil((reference - state[i, OFF] - low) / step) + 1, -_FAR))
    band[1, i] = int(max(min(np.floor((reference + state[i, ON] - leaked - low) / step) - 1, _FAR), -_FAR))


@njit(cache=True, nogil=True, error_model="numpy")
def renew_bands(state: State, band: Band, scale: tuple[float, float], valid: float) -> None:
    """Make the bands of all pixels hold up to time `valid`, ns; an empty one stays so until the pixel is touched."""
    for i in range(band.shape[1]):
        if band[0, i] <= band[1, i]:
            find_band(state, band, i, scale, valid)


@njit(cache=True, nogil=True, error_model="numpy")
def mark_active(band: Band, exposure: Exposure, active: Flags) -> None:
    """Write into active (N,) which pixels may make an event or change their state in a step, but for shot noise."""
    before, after = exposure.before, exposure.after
    least, most = band[0], band[1]
    down, up = exposure.margin
    if len(exposure.response.tau) > 0:
        unsteady = down != 0 or up != 0
        for i in range(len(before)):
            a = np.int32(before[i])
            active[i] = unsteady | (after[i] != before[i]) | (a < least[i]) | (a > most[i])
        return
    for i in range(len(before)):
        a, b = np.int32(before[i]), np.int32(after[i])
        active[i] = (min(a, b) + down < least[i]) | (max(a, b) + up > most[i])


@njit(cache=True, nogil=True, error_model="numpy")
def catch_up(state: State, active: Indices, exposure: Exposure) -> None:
    """Bring the pixels `active` (M,), to which nothing has happened meanwhile, to the beginning of the step."""
    begin, flicker = exposure.borders[0], exposure.flicker[0]
    filtered = len(exposure.response.tau) > 0
    # In a loop of its own, since the pixels lie far apart in memory: here their loads overlap.
    for i in active:
        if not filtered:
            state[i, SIGNAL] = exposure.low + exposure.before[i] * exposure.step + flicker
        state[i, REFERENCE] -= state[i, LEAK] * (begin - state[i, SINCE])
        state[i, SINCE] = begin


@njit(cache=True, nogil=True, error_model="numpy")
def expose(state: State, band: Band, active: Indices, exposure: Exposure, shots: Shots, out: Rows) -> Rows:
    """Carry the pixels `active` (M,), sorted, through one step and return their events in the form of `write_event`.

    state (N, 8) and band (2, N), see `find_band`, are changed in place; bands hold up to exposure.valid. out: where to
    write, grown if need be.
    """
    out[0, 0] = 0
    before, after, lamp = exposure.before, exposure.after, (exposure.borders, exposure.flicker)
    low, step = exposure.low, exposure.step
    taus, refractory = exposure.response.tau, exposure.response.refractory
    filtered, steady = len(taus) > 0, exposure.margin == (0, 0)
    catch_up(state, active, exposure)
    k = 0
    for i in active:
        a, b = np.int64(before[i]), np.int64(after[i])
        light = (low + a * step, low + b * step, taus[(a + b) // 2] if filtered else 0.0)
        first = k
        while k < len(shots.pixel) and shots.pixel[k] == i:
            k += 1
        if k > first:
            mine = Shots(shots.pixel[first:k], shots.time[first:k], shots.polarity[first:k], shots.level[first:k])
            out = follow_shots(state, i, light, exposure, mine, out)
        else:
            out = follow_step(state, i, light, lamp, refractory, out)
        moving = filtered and (not steady or abs(state[i, SIGNAL] - light[1]) > _SETTLED)
        if moving or state[i, BLIND] > state[i, SINCE]:
            band[0, i], band[1, i] = 1, 0
        else:
            find_band(state, band, i, (low, step), exposure.valid)
    return out
