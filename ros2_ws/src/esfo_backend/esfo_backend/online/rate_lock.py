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
"""Growth of the stream after which a search with an uncertain axis is repeated."""

_BINS_PER_REVOLUTION = 128
"""Bins of activity per revolution that suffice to distinguish periods."""


@dataclass(frozen=True)
class RateLock:
    """Rate and initialisation of the last search.

    revolutions: number observed when the rate was last confirmed. certain: whether the axis is certain.
    """

    rate: SpinRate
    initialisation: Initialisation
    revolutions: float
    certain: bool

    def doubtful(self, revolutions: float) -> bool:
        """Whether to repeat the search after this number of revolutions, because the axis is uncertain."""
        return not self.certain and revolutions > _MORE * self.revolutions

    def unconfirmed(self, revolutions: float) -> bool:
        """Whether to search the period again: it was found from few revolutions."""
        return 2 * self.revolutions <= min(revolutions, 2 * _CERTAIN_REVOLUTIONS)

    def confirmed(self, activity: Activity, revolutions: float, options: SpinRateOptions) -> RateLock:
        """Search the period again, after this number of revolutions. Raises BackendError when it differs."""
        per_revolution = NS_PER_S / (self.rate.rate_hz * activity.bin)
        rate = correlation_rate(coarser(activity, max(1, int(per_revolution / _BINS_PER_REVOLUTION))), options)
        if not rate.agrees_with(self.rate.rate_hz):
            raise BackendError(
                f"the spin rate of the event stream is {rate.rate_hz:.4f} Hz, no longer {self.rate.rate_hz:.4f} Hz"
            )
        return replace(self, rate=rate, revolutions=revolutions)
