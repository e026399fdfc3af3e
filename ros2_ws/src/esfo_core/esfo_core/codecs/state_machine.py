"""Base class of the decoders of stateful encodings: each word changes the state or emits events."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from esfo_core.codecs.base import Decoder

# Head of every state (int64): sensor size in px, counters of the latest packet, what has been seen (bits).
WIDTH, HEIGHT, OUT_OF_RANGE, UNSYNCHRONISED, UNKNOWN, SEEN = range(6)
HEAD = 6
"""Where the state of an encoding begins."""


class StateDecoder(Decoder):
    """A decoder whose kernel keeps everything between words in the array `_state`."""

    state_size: ClassVar[int]

    def __init__(self, width: int, height: int) -> None:
        super().__init__(width, height)
        self._state = np.zeros(HEAD + self.state_size, np.int64)
        self._state[WIDTH], self._state[HEIGHT] = width, height

    def _count(self, triggers: NDArray[np.void]) -> None:
        """Take over the triggers (K,) and the counters of the packet just decoded."""
        self.triggers = triggers
        rising = int(np.count_nonzero(triggers["edge"]))
        state, statistics = self._state, self.statistics
        statistics.triggers_rising += rising
        statistics.triggers_falling += len(triggers) - rising
        statistics.out_of_range += int(state[OUT_OF_RANGE])
        statistics.unsynchronised += int(state[UNSYNCHRONISED])
        statistics.unknown_words += int(state[UNKNOWN])
        state[OUT_OF_RANGE : UNKNOWN + 1] = 0
