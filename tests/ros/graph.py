"""The nodes as executables, where `ros2 run` looks for them."""

from pathlib import Path

from ament_index_python.packages import get_package_prefix

FRONTEND = ("esfo_frontend", "frontend_node")
BACKEND = ("esfo_backend", "backend_node")
REPLAY = ("esfo_bringup", "replay_node")


def executable(package: str, name: str) -> Path:
    """Return the path of a node."""
    return Path(get_package_prefix(package)) / "lib" / package / name
