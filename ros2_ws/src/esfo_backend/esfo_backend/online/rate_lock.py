"""Rate and initialisation that incremental estimates reuse, and how certain they are."""

from __future__ import annotations

from dataclasses import dataclass, replace

from esfo_backend.errors import BackendError
from esfo_backend.initialise.initialisation import Initialisation
from esfo_backend.online.stream_memory import coarser
from esfo_backend.options import SpinRateOptions
from esfo_backend.spin_rate.correlation import SpinRate, correlation_rate
from esfo_core.activity import Activity
from esfo_core.events import NS_PER_S

_CERTAIN_REVOLUTIONS = 4.0
"""Revolutions after which the period is final: it is not searched again."""

_MORE = 1.25
"""Growth of the stream after which a search is repeated that left a doubt about the axis."""

_BINS_PER_REVOLUTION = 128
"""Bins of activity per revolution that are enough to tell periods apart."""


@dataclass(frozen=True)
class RateLock:
    """Rate and initialisation of the last search.

    revolutions: seen when the rate was last confirmed. certain: the search left no doubt about the axis.
    """

    rate: SpinRate
    initialisation: Initialisation
    revolutions: float
    certain: bool

    def doubtful(self, revolutions: float) -> bool:
        """Whether to search again, after so many revolutions."""
        return not self.certain and revolutions > _MORE * self.revolutions

    def unconfirmed(self, revolutions: float) -> bool:
        """Whether to search the period again: it may have been taken for the true one too early."""
        return 2 * self.revolutions <= min(revolutions, 2 * _CERTAIN_REVOLUTIONS)

    def confirmed(self, activity: Activity, revolutions: float, options: SpinRateOptions) -> RateLock:
        """Search the period again, after so many revolutions. Raises BackendError when the stream has another one."""
        per_revolution = NS_PER_S / (self.rate.rate_hz * activity.bin)
        rate = correlation_rate(coarser(activity, max(1, int(per_revolution / _BINS_PER_REVOLUTION))), options)
        if not rate.agrees_with(self.rate.rate_hz):
            raise BackendError(f"the event stream repeats at {rate.rate_hz:.4f} Hz, not at {self.rate.rate_hz:.4f} Hz")
        return replace(self, rate=rate, revolutions=revolutions)
