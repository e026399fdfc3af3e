"""When to log what goes on and on."""

from __future__ import annotations

import time
from collections.abc import Callable


class Reminder:
    """Says when problems are worth a line: when one of another kind begins, and now and then while they last."""

    def __init__(self, repeat_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._repeat_s, self._clock = repeat_s, clock
        self._kinds: frozenset[str] = frozenset()
        self._when = 0.0

    def due(self, kinds: frozenset[str]) -> bool:
        """Return whether these kinds of problems have to be told now; they then count as told."""
        now = self._clock()
        new, self._kinds = kinds - self._kinds, kinds
        if not kinds or not (new or now - self._when > self._repeat_s):
            return False
        self._when = now
        return True
