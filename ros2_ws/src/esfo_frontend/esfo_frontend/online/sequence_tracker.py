"""Sequence numbers of packets: which are missing, and when the sender began to count anew."""

from __future__ import annotations

from enum import Enum

WRAP = 2**64
"""Numbers of packets count modulo this."""

MAX_GAP = 100_000
"""A step ahead by more than this is no loss but another count: at 1000 packets per second it would be 100 s."""

MEMORY = 16
"""A number up to this far behind the latest is a packet repeated or overtaken; further behind, the count began anew."""


class Turn(Enum):
    """What a number says: next after the latest, after a gap, older than others were, or of a count begun anew."""

    NEXT = 0
    GAP = 1
    STALE = 2
    RESTART = 3


class SequenceTracker:
    """Follows the numbers of one sender.

    lost: numbers missing so far; one that comes after all is taken off again. restarts: times that the count began
    anew, which is no loss.
    """

    def __init__(self) -> None:
        self.lost = 0
        self.restarts = 0
        self._latest: int | None = None
        self._missing: set[int] = set()
        self._doubted: int | None = None

    def take(self, number: int | None) -> Turn:
        """Take in the number of the next packet, None of one whose number cannot be read: it counts as the next."""
        if self._latest is None or number is None:
            self._latest = number if self._latest is None else (self._latest + 1) % WRAP
            return Turn.NEXT
        ahead = (number - self._latest) % WRAP
        if 0 < ahead <= MAX_GAP:
            self._advance(ahead)
            return Turn.NEXT if ahead == 1 else Turn.GAP
        if (WRAP - ahead) % WRAP < MEMORY and self._is_stale(number):
            return Turn.STALE
        self._missing.clear()
        self._latest, self._doubted = number, None
        self.restarts += 1
        return Turn.RESTART

    def forget(self) -> None:
        """Forget the latest number: whatever follows is the next. The counts stay."""
        self._latest = self._doubted = None
        self._missing.clear()

    def _advance(self, ahead: int) -> None:
        latest = ((self._latest or 0) + ahead) % WRAP
        self.lost += ahead - 1
        self._missing |= {(latest - back) % WRAP for back in range(1, min(ahead, MEMORY))}
        self._missing = {number for number in self._missing if (latest - number) % WRAP < MEMORY}
        self._latest, self._doubted = latest, None

    def _is_stale(self, number: int) -> bool:
        """Whether a number just behind the latest is late or repeated, and not the second one of another count."""
        if number in self._missing:
            self._missing.remove(number)
            self.lost -= 1
            return True
        anew = self._doubted is not None and number == (self._doubted + 1) % WRAP
        self._doubted = number
        return not anew
