"""Real recordings beside the repository, and what a right reader must find in them (from their publishers' tests)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"


@dataclass(frozen=True)
class Truth:
    name: str
    encoding: str
    width: int
    height: int
    packets: int | None  # None: blocks of a plain file
    off: int
    on: int
    duration: float  # s, to the millisecond
    triggers: tuple[int, int] = (0, 0)  # rising, falling


# The publisher's test of the first two states 2078 triggers of each edge but checks one edge only; its sum of all
# times, tested below, is reached with 2079 rising ones, which alternate with 2078 falling ones.
TRUTHS = (
    Truth("ros_bags/evt3_ros2_db3", "evt3", 640, 480, 517, 218_291, 125_183, 2.078, (2079, 2078)),
    Truth("ros_bags/evt3_ros1.bag", "evt3", 640, 480, 517, 218_291, 125_183, 2.078, (2079, 2078)),
    Truth("ros_bags/libcaer_cmp_ros2_mcap", "libcaer_cmp", 346, 260, 100, 360_223, 211_043, 1.000),
    Truth("ros_bags/evt3_trigger_ros2_db3", "evt3", 1280, 720, 105, 82_469 - 41_439, 41_439, 1.251, (1, 1)),
    Truth("ros_bags/libcaer_rollover_ros2_db3", "libcaer", 640, 480, 201, 334_331 - 181_908, 181_908, 2.000),
    Truth("raw/evt3.raw", "evt3", 1280, 720, None, 665_323, 553_295, 10.768),
    Truth("raw/gen4.dat", "dat", 1280, 720, None, 665_323, 553_295, 10.768),
    Truth("raw/evt2.raw", "evt2", 640, 480, None, 521_252 - 185_861, 185_861, 0.0959),
)


def recording(name: str) -> Path:
    """Path of a real recording; skips the test where the recordings are absent."""
    path = DATA / name
    if not path.exists():
        pytest.skip(f"the recordings of ../shared/data are not here ({name})")
    return path
