"""Events that another library has read, as columns; the decoder checks pixels and order only."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from esfo_core.codecs.base import Decoder
from esfo_core.events import EVENT_DTYPE, EventArray


class ColumnsDecoder(Decoder):
    """Takes events in the memory layout of `EVENT_DTYPE`."""

    word = EVENT_DTYPE

    def _decode(self, words: NDArray[Any], time_base: int) -> EventArray:
        inside = self._inside(words["x"], words["y"])
        return words if inside.all() else words[inside]
