"""What the tests over DDS share: a node that listens, and the recording of a small scene."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import spinning_squares

from esfo_core.recordings import write_mcap

DURATION_S = 1.9


@pytest.fixture
def listener(ros_domain: int) -> Iterator[Any]:
    """A node of the test itself."""
    from listener import Listener  # here, for other tests of this folder run without ROS

    it = Listener(ros_domain)
    yield it
    it.close()


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Squares on a spinning drum, 1.9 turns."""
    path = tmp_path_factory.mktemp("recording") / "squares.mcap"
    write_mcap(path, spinning_squares.events(DURATION_S), spinning_squares.CAMERA)
    return path
