"""Types and files of the event-based structure-from-orbit pipeline, without ROS."""

import os
from pathlib import Path

from esfo_core.compile_cache import ensure_writable_cache

__version__ = "0.1.0"

ensure_writable_cache(os.environ, Path(__file__).parent)  # before any module compiles
