"""What the lines of a text of events hold."""

from __future__ import annotations

from dataclasses import dataclass

from esfo_core.errors import RecordingError

COLUMNS = ("x", "y", "p", "t")
"""Columns that a text of events must have."""

UNIT_POWERS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
"""Units of time, as powers of ten in nanoseconds."""


@dataclass(frozen=True)
class TextLayout:
    """What the lines of a text hold.

    columns: name of each, those of `COLUMNS` once each and others, which are skipped. time_unit: s, ms, us or ns.
    """

    columns: tuple[str, ...]
    time_unit: str

    def __post_init__(self) -> None:
        if any(self.columns.count(name) != 1 for name in COLUMNS):
            raise RecordingError(f"columns are {','.join(self.columns)!r}; needed are x, y, p and t, once each")
        if self.time_unit not in UNIT_POWERS:
            raise RecordingError(f"time unit is {self.time_unit!r}; choose from {', '.join(UNIT_POWERS)}")
