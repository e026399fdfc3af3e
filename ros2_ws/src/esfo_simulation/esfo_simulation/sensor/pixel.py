"""One pixel of an event sensor, through a stretch of time in which its light is known.

An event falls where the photoreceptor's output has moved by a threshold from the pixel's reference; its time is that of
the continuous signal (ESIM, Rebecq et al., CoRL 2018). Leak lets the reference fall, shot noise makes events by chance
(v2e, Hu et al., CVPRW 2021). Any event resets the pixel: when its dead time ends, the reference is the present output
(Lichtsteiner et al., JSSC 2008).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_simulation.sensor.photoreceptor import first_crossing, photoreceptor

Column = NDArray[np.float64]
State = NDArray[np.float64]
Rows = NDArray[np.int64]

SHOT_BRIGHT = 0.25
"""Rate of shot noise at the brightest level, relative to the dark (v2e)."""

PLACE, ON, OFF, LEAK, REFERENCE, SIGNAL, SINCE, BLIND = range(8)
"""Columns of the state of pixels (N, 8), one cache line each.

PLACE in the sensor, row by row; thresholds ON and OFF; LEAK, fall of the reference per ns; REFERENCE and SIGNAL
(output of the photoreceptor) at time SINCE; BLIND, end of the dead time. Log intensity and ns.
"""


@njit(cache=True, nogil=True, error_model="numpy")
def write_event(out: Rows, time: float, code: int) -> Rows:
    """Append (ns, 2 place + polarity) to out, whose first row begins with the number of events; a full one grows."""
    n = out[0, 0] + 1
    if n == len(out):
        grown = np.empty((2 * n, 2), np.int64)
        grown[:n] = out
        out = grown
    out[0, 0], out[n, 0], out[n, 1] = n, int(time), code
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def follow(state: State, i: int, stop: float, light: tuple[float, float, float], refractory: float, out: Rows) -> Rows:
    """Carry pixel i to time `stop`, under light (log intensity now, its slope per ns, time constant in ns)."""
    level, slope, tau = light
    t, reference, signal, blind = state[i, SINCE], state[i, REFERENCE], state[i, SIGNAL], state[i, BLIND]
    on, off, leak = state[i, ON], state[i, OFF], state[i, LEAK]
    lag = slope * tau
    if tau > 0.0 and blind <= t:
        # The output stays between itself and its input.
        last = level + slope * (stop - t)
        highest, lowest = max(signal, level, last) - reference, min(signal, level, last) - reference
        if highest + leak * (stop - t) < on and lowest > -off:
            state[i, SIGNAL] = photoreceptor(signal, level, slope, tau, stop - t)
            state[i, REFERENCE], state[i, SINCE] = reference - leak * (stop - t), stop
            return out
    while True:
        if blind > t:
            u = min(blind, stop) - t
            signal = photoreceptor(signal, level, slope, tau, u)
            reference = signal
            level += slope * u
            t = min(blind, stop)
            if blind >= stop:
                break
        line = (level - lag - reference, slope + leak, signal - level + lag if tau > 0.0 else 0.0)
        u, sign = first_crossing(line, tau, stop - t, on, off)
        signal = photoreceptor(signal, level, slope, tau, u)
        level += slope * u
        t += u
        if sign == 0:
            reference -= leak * u
            break
        reference = signal
        blind = t + refractory
        out = write_event(out, t, 2 * int(state[i, PLACE]) + (1 if sign > 0 else 0))
    state[i, SINCE], state[i, REFERENCE], state[i, SIGNAL], state[i, BLIND] = stop, reference, signal, blind
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def follow_step(
    state: State, i: int, light: tuple[float, float, float], lamp: tuple[Column, Column], refractory: float, out: Rows
) -> Rows:
    """Carry pixel i through a step without shot noise.

    light: its log intensity at both ends but for the flicker; time constant, ns. lamp: borders that cut the step into
    parts, (S + 1,) ns, and what flicker adds to the log intensity there, (S + 1,).
    """
    borders, flicker = lamp
    start, end, tau = light
    slope = (end - start) / (borders[-1] - borders[0])
    for s in range(len(borders) - 1):
        level = start + slope * (borders[s] - borders[0]) + flicker[s]
        rise = slope + (flicker[s + 1] - flicker[s]) / (borders[s + 1] - borders[s])
        out = follow(state, i, borders[s + 1], (level, rise, tau), refractory, out)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def cut(lamp: tuple[Column, Column], begin: float, end: float) -> tuple[Column, Column]:
    """Return the part of `lamp`, see `follow_step`, from begin to end, ns."""
    borders, flicker = lamp
    inner = borders[(borders > begin) & (borders < end)]
    part = np.empty(len(inner) + 2)
    part[0], part[-1] = begin, end
    part[1:-1] = inner
    return part, np.interp(part, borders, flicker)


@njit(cache=True, nogil=True, error_model="numpy")
def shoot(state: State, i: int, shot: tuple[float, int, float], white: float, refractory: float, out: Rows) -> Rows:
    """Let shot noise fall on pixel i, which stands at that time.

    shot: ns; polarity; what the rate here, relative to the dark, must exceed. white: brightest log intensity.
    """
    t, polarity, level = shot
    bright = min(np.exp(state[i, SIGNAL] - white), 1.0)
    if t < state[i, BLIND] or level >= 1.0 + (SHOT_BRIGHT - 1.0) * bright:
        return out
    state[i, REFERENCE] = state[i, SIGNAL]
    state[i, BLIND] = t + refractory
    return write_event(out, t, 2 * int(state[i, PLACE]) + polarity)
