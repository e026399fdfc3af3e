"""What estimates that follow a search rest on: its rate and its start, and how sure they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from esfo_backend.adjustment.bundle_adjustment import OrbitSolution
from esfo_backend.errors import BackendError
from esfo_backend.initialise.initialisation import Initialisation
from esfo_backend.online.stream_memory import coarser
from esfo_backend.options import SpinRateOptions
from esfo_backend.orbit.parametrization import Motion
from esfo_backend.spin_rate.correlation import Harmonic, SpinRate, correlation_rate
from esfo_core.activity import Activity
from esfo_core.orbit import NS_PER_S, Matrix

_CERTAIN_TURNS = 4.0
"""Turns after which the period is not looked at anew: it does not change its mind any more."""

_MORE = 1.25
"""Growth of the stream after which an estimate that leaves a doubt is searched anew."""

_BINS_PER_TURN = 128
"""Bins of activity that are enough to tell periods apart."""


@dataclass(frozen=True)
class RateLock:
    """Rate and start of the last search.

    turns: seen when they were last confirmed. certain: the search left no doubt about the axis.
    """

    rate: SpinRate
    initialisation: Initialisation
    turns: float
    certain: bool

    def doubtful(self, turns: float) -> bool:
        """Whether a search has to be made anew, after so many turns."""
        return not self.certain and turns > _MORE * self.turns

    def unconfirmed(self, turns: float) -> bool:
        """Whether to look at the period again: it may have been taken for the true one too early."""
        return 2 * self.turns <= min(turns, 2 * _CERTAIN_TURNS)

    def confirmed(self, activity: Activity, turns: float, options: SpinRateOptions) -> RateLock:
        """Look at the period again, after so many turns. Raises BackendError when the stream has another one by now."""
        per_turn = NS_PER_S / (self.rate.rate_hz * activity.bin)
        rate = correlation_rate(coarser(activity, max(1, int(per_turn / _BINS_PER_TURN))), options)
        if not rate.agrees_with(self.rate.rate_hz):
            raise BackendError(f"the event stream repeats at {rate.rate_hz:.4f} Hz, not at {self.rate.rate_hz:.4f} Hz")
        return replace(self, rate=rate, turns=turns)

    def arrays(self) -> dict[str, ArrayLike]:
        """Return it as arrays for a file; the points of the start are left out, nothing needs them any more."""
        second = [] if self.initialisation.second is None else [self.initialisation.second]
        optima = [[*a.motion.Q.ravel(), a.motion.rate_hz, a.cost] for a in (self.initialisation.solution, *second)]
        harmonics = [[h.rate_hz, h.correlation, h.z] for h in self.rate.harmonics]
        return {
            "basis_rate": [self.rate.rate_hz, self.rate.correlation, self.rate.prominence],
            "basis_harmonics": np.reshape(harmonics, (-1, 3)),
            "basis_optima": optima,
            "basis_start": [self.initialisation.name, self.initialisation.colmap_note],
            "basis_turns": self.turns,
            "basis_certain": self.certain,
        }

    @staticmethod
    def from_arrays(arrays: Mapping[str, NDArray[np.generic]]) -> RateLock:
        """Read what `arrays` gave. Raises KeyError or ValueError for anything else."""
        rate, correlation, prominence = (float(v) for v in np.asarray(arrays["basis_rate"], np.float64))
        harmonics = [Harmonic(*row) for row in np.asarray(arrays["basis_harmonics"], np.float64).tolist()]
        best, *second = [_optimum(row) for row in np.asarray(arrays["basis_optima"], np.float64)]
        name, note = (str(v) for v in arrays["basis_start"])
        start_name: Literal["colmap", "direct"] = "colmap" if name == "colmap" else "direct"
        return RateLock(
            SpinRate(rate, correlation, prominence, tuple(harmonics)),
            Initialisation(best, start_name, second[0] if second else None, note),
            float(np.asarray(arrays["basis_turns"], np.float64)),
            bool(arrays["basis_certain"]),
        )


def _optimum(row: Matrix) -> OrbitSolution:
    return OrbitSolution(Motion(row[:9].reshape(3, 3), float(row[9])), np.empty((0, 3)), float(row[10]), 0)
