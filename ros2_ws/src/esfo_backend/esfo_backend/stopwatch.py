"""Durations of the stages of an estimate."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

STAGES = ("spin_rate", "initialisation", "reidentification", "graph")
"""Names of the stages of an estimate, in their order."""


@dataclass
class Stopwatch:
    """Measures the stages of an estimate; on_stage is called with the name of each as it begins."""

    on_stage: Callable[[str], None]
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what happens within the context."""
        self.on_stage(name)
        begin = time.perf_counter()
        yield
        self.seconds[name] = round(time.perf_counter() - begin, 3)
