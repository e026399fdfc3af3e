"""Properties of a recording that the user may give where a file lacks them."""

from __future__ import annotations

from dataclasses import dataclass

from esfo_core.errors import OptionError
from esfo_core.options import option


@dataclass(frozen=True)
class ReadingOptions:
    """Properties for files that do not state them; the empty value of each leaves it to the reader."""

    width: int = option(0, "sensor width in pixels; 0: from the file, else inferred from the events", 0, 65536)
    height: int = option(0, "sensor height in pixels; 0: from the file, else inferred from the events", 0, 65536)
    columns: str = option("", "column names of a text file, such as t,x,y,p; others are skipped; empty: inferred")
    time_unit: str = option(
        "", "unit of the times in a text file; empty: inferred", choices=("", "s", "ms", "us", "ns")
    )
    segment: int = option(
        -1,
        "index, from 0, of the segment to read where the clock was set back; -1: the one with the most events",
        -1,
        999,
    )

    @property
    def size(self) -> tuple[int, int] | None:
        """Sensor size in pixels, None where it is not told. Raises OptionError where only one of the two is."""
        if bool(self.width) != bool(self.height):
            raise OptionError(f"a sensor of {self.width}x{self.height} px: give both, width and height, or none")
        return (self.width, self.height) if self.width else None
