"""What a reader cannot always find in a file and the user may say."""

from __future__ import annotations

from dataclasses import dataclass

from esfo_core.errors import OptionError
from esfo_core.options import option


@dataclass(frozen=True)
class ReadingOptions:
    """Facts for files that do not hold them; the empty value of each leaves it to the reader."""

    width: int = option(0, "sensor width in pixels, for text and HDF5 files; 0: the largest x plus 1", 0, 65536)
    height: int = option(0, "sensor height in pixels, for text and HDF5 files; 0: the largest y plus 1", 0, 65536)
    columns: str = option("", "columns of a text, such as t,x,y,p; other names are skipped; empty: found out")
    time_unit: str = option("", "unit of the times of a text; empty: found out", choices=("", "s", "ms", "us", "ns"))
    segment: int = option(0, "which stretch to read of a recording whose clock is set back, from 0", 0, 999)

    @property
    def size(self) -> tuple[int, int] | None:
        """Sensor size in pixels, None where it is not told. Raises OptionError where only one of the two is."""
        if bool(self.width) != bool(self.height):
            raise OptionError(f"a sensor of {self.width}x{self.height} px: give both, width and height, or none")
        return (self.width, self.height) if self.width else None
