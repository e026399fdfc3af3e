"""Sequence numbers of packets: gaps, late and repeated packets, and restarts of the count."""

from __future__ import annotations

from enum import Enum

WRAP = 2**64
"""Sequence numbers are counted modulo this."""

MAX_GAP = 100_000
"""A step ahead by more than this is a restart, not a loss: at 1000 packets per second it would be 100 s."""

MEMORY = 16
"""A number up to this far behind the latest is of a repeated or overtaken packet; one further behind, a restart."""


class SequenceStep(Enum):
    """Relation of a number to the earlier ones: the next, after a gap, stale (repeated or overtaken), or a restart."""

    NEXT = 0
    GAP = 1
    STALE = 2
    RESTART = 3


class SequenceTracker:
    """Follows the sequence numbers of one sender.

    lost: numbers missing so far; one that arrives late is subtracted again. restarts: restarts of the count, which are
    not losses.
    """

    def __init__(self) -> None:
        self.lost = 0
        self.restarts = 0
        self._latest: int | None = None
        self._missing: set[int] = set()
        self._doubted: int | None = None

    def take(self, number: int | None) -> SequenceStep:
        """Take in the number of the next packet; None, where it cannot be read, counts as the next number."""
        if self._latest is None or number is None:
            self._latest = number if self._latest is None else (self._latest + 1) % WRAP
            return SequenceStep.NEXT
        ahead = (number - self._latest) % WRAP
        if 0 < ahead <= MAX_GAP:
            self._advance(ahead)
            return SequenceStep.NEXT if ahead == 1 else SequenceStep.GAP
        if (WRAP - ahead) % WRAP < MEMORY and self._is_stale(number):
            return SequenceStep.STALE
        self._missing.clear()
        self._latest, self._doubted = number, None
        self.restarts += 1
        return SequenceStep.RESTART

    def forget(self) -> None:
        """Forget the latest number: any number may follow. The counts stay."""
        self._latest = self._doubted = None
        self._missing.clear()

    def _advance(self, ahead: int) -> None:
        latest = ((self._latest or 0) + ahead) % WRAP
        self.lost += ahead - 1
        self._missing |= {(latest - back) % WRAP for back in range(1, min(ahead, MEMORY))}
        self._missing = {number for number in self._missing if (latest - number) % WRAP < MEMORY}
        self._latest, self._doubted = latest, None

    def _is_stale(self, number: int) -> bool:
        """Whether a number just behind the latest is late or repeated, and not the second number after a restart."""
        if number in self._missing:
            self._missing.remove(number)
            self.lost -= 1
            return True
        anew = self._doubted is not None and number == (self._doubted + 1) % WRAP
        self._doubted = number
        return not anew
