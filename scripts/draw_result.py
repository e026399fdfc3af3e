"""Draw a moment of a result.mcap: the overlay, and the points, axis and orbit in space.

A rendering of the topics `overlay`, `points`, `markers` and `/tf` with Matplotlib, for documents; in RViz and Foxglove
they move.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

mpl.use("Agg")

MOMENT = 0.3
"""Part of the recording after which the moment is."""

DPI = 110


def read(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Read the four topics: messages with their log times, ns."""
    wanted = ("/overlay", "/points", "/markers", "/tf")
    with AnyReader([path]) as bag:
        found: dict[str, list[tuple[int, Any]]] = {name: [] for name in wanted}
        for connection, t, data in bag.messages([c for c in bag.connections if c.topic in wanted]):
            found[connection.topic].append((t, bag.deserialize(data, connection.msgtype)))
    return found


def at(messages: list[tuple[int, Any]], t: int) -> Any:
    """Return the message nearest to `t`."""
    return min(messages, key=lambda entry: abs(entry[0] - t))[1]


def stamp(message: Any) -> int:
    """Return the time in the header of a message, ns."""
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def show_overlay(panel: Axes, image: Any) -> None:
    """Show the picture pixel by pixel."""
    panel.imshow(image.data.reshape(image.height, image.width, 3), interpolation="nearest")
    panel.set_title("overlay: events, tracks, screw line")
    panel.set_xticks([])
    panel.set_yticks([])


def show_space(panel: Axes3D, cloud: Any, transform: Any, markers: Any, near: bool) -> None:
    """Show points, coloured by their reprojection error, and axis; from near, or with the orbit about the object."""
    q, p = transform.rotation, transform.translation
    R = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    columns = np.frombuffer(cloud.data.tobytes(), "<f4").reshape(-1, 5)
    X = columns[:, :3] @ R.T + [p.x, p.y, p.z]
    panel.scatter(*upright(X), c=columns[:, 3], s=6 if near else 1, cmap="viridis", vmin=0.0, vmax=1.5)
    for marker in markers.markers:
        if marker.points and not (near and marker.id):
            way = np.array([[v.x, v.y, v.z] for v in marker.points])
            colour = (marker.color.r, marker.color.g, marker.color.b)
            panel.plot(*upright(way), color=colour, lw=2, label={0: "axis", 1: "orbit of the camera"}[marker.id])
    if not near:
        panel.plot(*upright(np.zeros((1, 3))), "k^", ms=9, label="camera")
    panel.set_aspect("equal")
    panel.locator_params(nbins=4)
    panel.view_init(elev=12, azim=-80)
    panel.legend(loc="upper left")
    panel.set_title("points" if near else "orbit (radii)")


def upright(X: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn camera coordinates (N, 3), y down, into (3, N) with z up."""
    return np.stack([X[:, 0], X[:, 2], -X[:, 1]])


def main(bag: Path, picture: Path) -> None:
    """Draw one moment of a bag."""
    topics = read(bag)
    first, last = topics["/tf"][0][0], topics["/tf"][-1][0]
    cloud = at(topics["/points"], round(first + MOMENT * (last - first)))
    t = stamp(cloud)
    figure = Figure(figsize=(15.0, 4.4), layout="constrained")
    pictures = figure.add_gridspec(1, 3, width_ratios=[1.3, 1.0, 1.0])
    show_overlay(figure.add_subplot(pictures[0]), at(topics["/overlay"], t))
    transform, markers = at(topics["/tf"], t).transforms[0].transform, topics["/markers"][-1][1]
    for place, near in ((pictures[1], True), (pictures[2], False)):
        show_space(figure.add_subplot(place, projection="3d"), cloud, transform, markers, near)
    figure.savefig(picture, dpi=DPI)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2] if len(sys.argv) > 2 else "docs/images/result.png"))
