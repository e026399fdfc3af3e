"""Tracks by association: each corner is assigned, when it arrives, to the track with the nearest prediction.

The corners of a feature lie on a narrow path in (x, y, t) whose direction is the feature's velocity. Clusters in a
space where time has one scale (section 4.2 of the paper) tell neighbouring paths apart only while the image moves
about as fast as that scale. Here each track predicts its position, so that all distances are pixels of the image: the
same options hold for every speed, and no corner waits for the end of a chunk.

The scheme is nearest-neighbour data association with a constant-velocity model (Bar-Shalom and Fortmann, Tracking and
Data Association, 1988); for corner events compare Alzugaray and Chli, "Asynchronous corner detection and tracking for
event cameras in real time", RA-L 2018.
"""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import NDArray

from esfo_core.events import EventArray
from esfo_core.tracks import Tracks, TrackUpdate
from esfo_frontend.association.kernels import Limits, associate
from esfo_frontend.association.track_table import ROW_DTYPE, SHARED_DTYPE, TRACK_DTYPE, Grid, expire
from esfo_frontend.clustering.track_windows import sigma_of_mean
from esfo_frontend.options import AssociationOptions, TrackOptions, nanoseconds

_SMALLEST_TABLE = 1024


class CornerAssociation:
    """Follows features through a stream of corners.

    A track is the straight line fitted to its corners, each weighted by exp(-s / memory), s = image motion since. A
    corner belongs to the track of its polarity that is predicted nearest, within `gate`; else it begins a track, unless
    one is nearer than `spacing`: the corners of one feature spread over some pixels. A track gets its id with its first
    row. It ends when it should have moved on by `coast` without a corner; a slow one when the typical track has moved
    by `wait`.

    A row is the mean position and time of the corners while the track moved on by `step`: rows come once per distance,
    not once per time, so that the motion within a row is small and the number of corners enough at any speed. It is
    moved ahead by `lag`, since corner events come when the corner has passed: the detector asks for an arc of older
    events round the pixel, and the sensor for a change that lies within the blur of the edge.
    """

    def __init__(
        self, width: int, height: int, options: AssociationOptions, tracks: TrackOptions, first_id: int = 0
    ) -> None:
        self._track_options = tracks
        self._limits = Limits(
            options.gate**2,
            options.spacing**2,
            options.memory,
            options.coast,
            options.wait,
            float(nanoseconds(options.longest_gap)),
            options.step**2,
            options.lag,
            options.first_corners,
            tracks.min_corners,
        )
        # A track is listed where it was at its last corner: from there it may be predicted `coast` farther.
        edge = float(ceil(max(options.gate, options.spacing) + options.coast))
        self._grid = Grid(np.full((ceil(height / edge), ceil(width / edge)), -1, np.int64), edge)
        self._tracks = np.zeros(0, TRACK_DTYPE)
        self._free = np.zeros(0, np.int64)
        self._shared = np.zeros(1, SHARED_DTYPE)
        self._shared["next_id"] = first_id

    @property
    def next_id(self) -> int:
        """Id of the next track."""
        return int(self._shared["next_id"][0])

    @property
    def idle(self) -> bool:
        """True when no track is alive."""
        return int(self._shared["free"][0]) == len(self._tracks)

    @property
    def speed(self) -> float:
        """Typical speed of the tracks in the image, px/s: a running median; 0 before the first track."""
        return float(self._shared["speed"][0])

    def add(self, corners: EventArray, end: int) -> tuple[NDArray[np.int64], TrackUpdate]:
        """Take in the corners (N,) before `end` ns, which follow the earlier ones.

        Returns the track of each corner (N,), -1 for none so far, and the new rows, in the order of their last corners,
        with the tracks that ended.
        """
        self._reserve(len(corners))
        label = np.empty(len(corners), np.int64)
        rows = np.empty(len(corners), ROW_DTYPE)
        columns = tuple(np.ascontiguousarray(corners[name]).astype(np.int64) for name in ("x", "y", "p", "t"))
        count = associate(columns, self._state, self._limits, label, rows)
        ended = np.empty(len(self._tracks), np.int64)
        ended = ended[: expire(self._state, end, ended)]
        return label, TrackUpdate(self._observations(rows[:count]), np.sort(ended).astype(np.uint32))

    @property
    def _state(self) -> tuple[object, ...]:
        return self._tracks, self._grid, self._shared, self._free

    def _reserve(self, number: int) -> None:
        """Make room for as many new tracks."""
        free, size = int(self._shared["free"][0]), len(self._tracks)
        if free >= number:
            return
        larger = max(_SMALLEST_TABLE, 2 * size, size + number)
        self._tracks = np.concatenate([self._tracks, np.zeros(larger - size, TRACK_DTYPE)])
        slots = np.zeros(larger, np.int64)
        slots[:free] = self._free[:free]
        slots[free : free + larger - size] = np.arange(size, larger)
        self._free = slots
        self._shared["free"] = free + larger - size

    def _observations(self, rows: NDArray[np.void]) -> Tracks:
        sigma = sigma_of_mean(rows["n"], rows["residual"], np.ones(len(rows), np.bool_), self._track_options)
        return Tracks.from_columns(rows["id"], rows["t"], np.stack([rows["u"], rows["v"]], axis=1), sigma)
