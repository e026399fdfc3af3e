"""Elimination of one landmark from the normal equations (Schur complement), by Cholesky.

The solver's steps and all covariances use it, with the same regularisation.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from esfo_core.orbit import Matrix

REGULARISATION = 1e-9
"""Added to the information of each landmark, px^2 per squared orbit radius: an unobserved depth stays finite.
Observed coordinates have an information of about the squared focal length in px, 1e13 times as much."""

_LEAST_PIVOT = 1e-12


@njit(cache=True, nogil=True)
def factor_landmark(D: Matrix, damping: float, L: Matrix) -> None:
    """Write the lower Cholesky factor of D + damping diag(D) + REGULARISATION I into L; all (3, 3)."""
    for m in range(3):
        for n in range(m + 1):
            L[m, n] = D[m, n]
        L[m, m] += damping * L[m, m] + REGULARISATION
        for n in range(m + 1):
            for k in range(n):
                L[m, n] -= L[m, k] * L[n, k]
            if n < m:
                L[m, n] /= L[n, n]
        L[m, m] = np.sqrt(max(L[m, m], _LEAST_PIVOT))  # rounding may make an unobserved depth negative


@njit(cache=True, nogil=True)
def solve_lower(L: Matrix, right: NDArray[np.floating], out: NDArray[np.floating]) -> None:
    """Write L^-1 right (3,) into out (3,)."""
    for m in range(3):
        value = right[m]
        for k in range(m):
            value -= L[m, k] * out[k]
        out[m] = value / L[m, m]
