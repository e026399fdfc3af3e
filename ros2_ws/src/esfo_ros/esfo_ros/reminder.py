"""When to log a problem that persists."""

from __future__ import annotations

import time
from collections.abc import Callable


class Reminder:
    """Decides when to log problems: when one of a new kind occurs, and every `repeat_s` seconds while they persist."""

    def __init__(self, repeat_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._repeat_s, self._clock = repeat_s, clock
        self._kinds: frozenset[str] = frozenset()
        self._when = 0.0

    def due(self, kinds: frozenset[str]) -> bool:
        """Return whether to log now that problems of these kinds exist; if so, they count as logged."""
        now = self._clock()
        new, self._kinds = kinds - self._kinds, kinds
        if not kinds or not (new or now - self._when > self._repeat_s):
            return False
        self._when = now
        return True
