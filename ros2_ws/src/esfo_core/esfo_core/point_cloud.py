"""Point clouds as PLY files, without the mesh library, which is slow to load."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from esfo_core.orbit import Matrix


def write_points(path: Path, points: Matrix) -> None:
    """Write points (N, 3) as a binary PLY of float32 vertices. Raises OSError when the file cannot be written."""
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n{axes}end_header\n"
    path.write_bytes(header.encode() + np.ascontiguousarray(points, "<f4").tobytes())
