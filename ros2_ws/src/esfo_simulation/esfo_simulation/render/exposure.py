"""Rows to sensor: the optical blur, and the logarithm in whole steps.

The grid of samples is twice as fine as the sensor. Only what was drawn to is touched, and the buffers are left as they
were found, so that a frame costs what the object covers.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

OVERSAMPLING = 2
# Beyond so many standard deviations all of a Gaussian weighs less than 1e-5.
_REACH_SIGMA = 4.5
_LN2 = np.float32(np.log(2.0))
# atanh(s) = s + s^3 / 3 + ... ; for a mantissa between 1 and 2 around sqrt(2), |s| < 0.172 and the rest is below 2e-8.
_SQRT2, _LN_SQRT2 = np.float32(np.sqrt(2.0)), np.float32(0.5 * np.log(2.0))
_C1, _C3, _C5, _C7 = np.float32(2), np.float32(2 / 3), np.float32(2 / 5), np.float32(2 / 7)


def blur_taps(blur_px: float) -> NDArray[np.float32]:
    """Weights (2 n,) of the samples around a pixel for a Gaussian blur of standard deviation blur_px; they add up to 1.

    A sample that a border crosses holds a mean over its width, which is a blur of its own: the variance of a box of
    half a pixel is taken off.
    """
    sigma = np.sqrt((OVERSAMPLING * blur_px) ** 2 - 1 / 12)
    reach = int(np.ceil(_REACH_SIGMA * sigma))
    weights = np.exp(-0.5 * ((np.arange(-reach, reach) + 0.5) / sigma) ** 2)
    return np.asarray(weights / weights.sum(), np.float32)


@njit(cache=True, nogil=True)
def whole_steps(radiance, low, step, bits, out):  # type: ignore[no-untyped-def]
    """Log radiance in whole steps above `low`: out = round((log(radiance) - low) / step), all (W,) but low and step.

    The logarithm is right to 1e-6. bits: (W,) int32, scratch.
    """
    pattern, mantissa = radiance.view(np.int32), bits.view(np.float32)
    for j in range(len(out)):
        bits[j] = (pattern[j] & 0x7FFFFF) | 0x3F800000
    scale, offset = np.float32(1.0 / step), np.float32(0.5 - low / step)
    for j in range(len(out)):
        exponent = np.float32(np.int32(pattern[j] >> 23) - np.int32(127))
        s = (mantissa[j] - _SQRT2) / (mantissa[j] + _SQRT2)
        s2 = s * s
        log = exponent * _LN2 + (_LN_SQRT2 + s * (_C1 + s2 * (_C3 + s2 * (_C5 + s2 * _C7))))
        out[j] = np.uint16(np.int32(log * scale + offset))


@njit(cache=True, nogil=True)
def fill(row, value):  # type: ignore[no-untyped-def]
    """Set all of a row: several times as fast as an assignment to a slice."""
    for x in range(len(row)):
        row[x] = value


@njit(cache=True, nogil=True)
def develop(rows, extent, taps, levels, out):  # type: ignore[no-untyped-def]
    """Blur and halve the columns, and take the logarithm.

    rows: (2 h + K - 2, w); extent: the first and last column of each that may differ from the background; taps: (K,);
    levels: low, step and the radiance of the background. out: (h, w) is set where it may differ from the background.
    Leaves rows the background and extent empty.
    """
    low, step, background = levels
    width = rows.shape[1]
    total, bits = np.empty(width, np.float32), np.empty(width, np.int32)
    last_tap = len(taps) - 1
    for i in range(len(out)):
        first, last = extent[2 * i : 2 * i + len(taps), 0].min(), extent[2 * i : 2 * i + len(taps), 1].max()
        if last < 0:
            continue
        row = total[first : last + 1]
        fill(row, np.float32(0.0))
        for k in range(len(taps) // 2):
            upper, lower = rows[2 * i + k, first : last + 1], rows[2 * i + last_tap - k, first : last + 1]
            for j in range(len(row)):
                row[j] += taps[k] * (upper[j] + lower[j])
        whole_steps(row, low, step, bits[first : last + 1], out[i, first : last + 1])
    for y in range(len(rows)):
        if extent[y, 1] >= 0:
            fill(rows[y, extent[y, 0] : extent[y, 1] + 1], background)
            extent[y, 0], extent[y, 1] = width, -1
