"""The photoreceptor of an event pixel: log intensity behind a first-order low pass, and when it crosses a threshold.

V' = (L - V) / tau, solved exactly for light L that goes linearly; tau is inverse to the light, as in v2e (Hu et al.,
CVPRW 2021). With a reference that leaks at a constant rate, what is compared with the thresholds is always of the form
a + b u + c exp(-u / tau).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.events import NS_PER_S

Column = NDArray[np.float64]

DARK = 20 / 255
"""Light by which bandwidth is limited in the dark, relative to the brightest level (v2e)."""
_CLOSE_NS = 1e-3


def time_constants(light: Column, white: float, bandwidth_hz: float) -> Column:
    """Return the time constants, ns, of photoreceptors that see log intensities (N,); 0 where bandwidth_hz is 0.

    They are inverse to the light, but for what flows in the dark; at log intensity `white` it is bandwidth_hz.
    """
    if not bandwidth_hz:
        return np.zeros(len(light))
    return np.asarray(NS_PER_S / (2 * np.pi * bandwidth_hz) * (1 + DARK) / (np.exp(light - white) + DARK))


@njit(cache=True, nogil=True, error_model="numpy")
def photoreceptor(signal: float, light: float, slope: float, tau: float, u: float) -> float:
    """Output after u ns, from `signal`, under light + slope u: the solution of V' = (L - V) / tau."""
    if tau == 0.0:
        return light + slope * u
    lag = slope * tau
    return float(light + slope * u - lag + (signal - light + lag) * np.exp(-u / tau))


@njit(cache=True, nogil=True, error_model="numpy")
def solve_monotone(a: float, b: float, c: float, tau: float, bracket: tuple[float, float]) -> float:
    """Root of a + b u + c exp(-u / tau) in a bracket where it is monotone and changes sign: Newton, else bisection."""
    left, right = bracket
    rising = a + b * right + c * np.exp(-right / tau) > 0.0
    u = 0.5 * (left + right)
    for _ in range(100):
        decay = c * np.exp(-u / tau)
        value = a + b * u + decay
        if (value > 0.0) == rising:
            right = u
        else:
            left = u
        gradient = b - decay / tau
        newton = u - value / gradient if gradient != 0.0 else left
        following = newton if left < newton < right else 0.5 * (left + right)
        if abs(following - u) < _CLOSE_NS:
            return following
        u = following
    return u


@njit(cache=True, nogil=True, error_model="numpy")
def first_crossing(
    line: tuple[float, float, float], tau: float, span: float, on: float, off: float
) -> tuple[float, int]:
    """First time u in 0..span at which a + b u + c exp(-u / tau) rises to `on` or falls to -off.

    line: (a, b, c). Returns u and 1 or -1; 0 for the sign where there is none.
    """
    a, b, c = line
    if tau == 0.0:
        if b > 0.0 and a + b * span >= on:
            return min(max((on - a) / b, 0.0), span), 1
        if b < 0.0 and a + b * span <= -off:
            return min(max((-off - a) / b, 0.0), span), -1
        return span, 0
    turn = span
    if b != 0.0 and c / (b * tau) > 1.0:
        turn = min(tau * np.log(c / (b * tau)), span)
    left, start = 0.0, a + c
    for right in (turn, span):
        stop = a + b * right + c * np.exp(-right / tau)
        if stop > start and stop >= on:
            return (left, 1) if start >= on else (solve_monotone(a - on, b, c, tau, (left, right)), 1)
        if stop < start and stop <= -off:
            return (left, -1) if start <= -off else (solve_monotone(a + off, b, c, tau, (left, right)), -1)
        left, start = right, stop
    return span, 0
