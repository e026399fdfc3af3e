"""Joining of clusters, head to tail, into tracks (section 4.2, equation 3)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from esfo_core.events import NS_PER_S, EventArray, empty_events
from esfo_frontend.clustering.chunk_clusterer import NOISE, SettledClusters
from esfo_frontend.options import JoinOptions


@dataclass(frozen=True)
class JoinedCorners:
    """What became known about tracks in one step.

    corners: (N,) corner events new to their tracks. track_id: (N,) int64.
    complete_until: for each living track the time, ns, before which it will get no more corners.
    ended: tracks that will get no more corners at all.
    """

    corners: EventArray
    track_id: NDArray[np.int64]
    complete_until: dict[int, int]
    ended: list[int]


@dataclass
class _Cluster:
    """A cluster that has not been joined to a successor yet."""

    id: int
    head: EventArray = field(default_factory=empty_events)
    tail: EventArray = field(default_factory=empty_events)
    undelivered: list[EventArray] = field(default_factory=list)
    track: int | None = None
    ended: bool = False

    def add(self, corners: EventArray, descriptor_size: int) -> None:
        if len(self.head) < descriptor_size:
            self.head = np.concatenate([self.head, corners[:descriptor_size]])[:descriptor_size]
        self.tail = np.concatenate([self.tail, corners[-descriptor_size:]])[-descriptor_size:]
        self.undelivered.append(corners)


class ClusterJoiner:
    """Joins the tail of a cluster to the nearest head in the forward hemisphere about it.

    The descriptor of a head (tail) is the mean (x, y, scaled t) of the first (last) N_sigma corners of a cluster. A
    pair is possible when the head is later than the tail and less than phi away. Possible pairs are taken nearest
    first, each tail and each head once. The stream is not seen whole: pairs compete among the heads that became known
    in the same step, and a head whose corners reach back before a time up to which its track was already declared
    complete is not joined to it.
    """

    def __init__(self, origin: int, time_scale: float, options: JoinOptions, first_id: int = 0) -> None:
        self._origin, self._scale = origin, time_scale
        self._options = options
        self._clusters: dict[int, _Cluster] = {}
        self._complete_until: dict[int, int] = {}
        self.next_id = first_id

    @property
    def idle(self) -> bool:
        """True when no cluster is open and none waits for a successor."""
        return not self._clusters

    def add(self, settled: SettledClusters) -> JoinedCorners:
        """Take in the settled corners of one chunk and return what they add to tracks."""
        self._collect(settled)
        heads = [c for c in self._clusters.values() if c.track is None and self._head_known(c, settled.known)]
        tails = [c for c in self._clusters.values() if c.ended]
        predecessor = self._match(tails, heads)
        for cluster in sorted(heads, key=lambda c: (self._descriptor(c.head)[2], c.id)):
            previous = predecessor.get(cluster.id)
            if previous is None:
                cluster.track = self.next_id
                self.next_id += 1
            else:
                # A head is later than the tail it is joined to, so that one has its track already.
                cluster.track = previous.track
                cluster.undelivered = previous.undelivered + cluster.undelivered
                del self._clusters[previous.id]
        ended = self._expire(settled.known)
        return self._deliver(settled.settled, ended)

    def _collect(self, settled: SettledClusters) -> None:
        c = settled.corners
        corners = np.empty(len(c), empty_events().dtype)
        corners["x"], corners["y"], corners["p"], corners["t"] = c.x, c.y, c.polarity, c.t
        order = np.argsort(c.label, kind="stable")
        ids, first = np.unique(c.label[order], return_index=True)
        for id_, rows in zip(ids.tolist(), np.split(order, first[1:]), strict=False):
            if id_ != NOISE:
                self._clusters.setdefault(id_, _Cluster(id_)).add(corners[rows], self._options.descriptor_size)
        for cluster in self._clusters.values():
            cluster.ended = cluster.id not in settled.open_ids

    def _scaled(self, t: int) -> float:
        return (t - self._origin) * (self._scale / NS_PER_S)

    def _descriptor(self, corners: EventArray) -> NDArray[np.float64]:
        t = (corners["t"] - self._origin) * (self._scale / NS_PER_S)
        return np.array([corners["x"].mean(), corners["y"].mean(), t.mean()])

    def _head_known(self, cluster: _Cluster, known: int) -> bool:
        complete = cluster.ended or len(cluster.head) == self._options.descriptor_size
        return complete and bool(self._descriptor(cluster.head)[2] < self._scaled(known))

    def _match(self, tails: list[_Cluster], heads: list[_Cluster]) -> dict[int, _Cluster]:
        """Return the tail's cluster for the id of each head that is joined."""
        if not tails or not heads:
            return {}
        tail = np.stack([self._descriptor(c.tail) for c in tails])
        head = np.stack([self._descriptor(c.head) for c in heads])
        step = head[None] - tail[:, None]
        distance2 = (step**2).sum(axis=2)
        i, j = np.nonzero((step[..., 2] > 0) & (distance2 < self._options.radius**2))
        predecessor: dict[int, _Cluster] = {}
        used: set[int] = set()
        for k in np.argsort(distance2[i, j], kind="stable"):
            before, after = tails[i[k]], heads[j[k]]
            if before.id in used or after.id in predecessor or not self._may_precede(before, after):
                continue
            used.add(before.id)
            predecessor[after.id] = before
        return predecessor

    def _may_precede(self, before: _Cluster, after: _Cluster) -> bool:
        complete_until = self._complete_until.get(before.track) if before.track is not None else None
        return complete_until is None or bool(after.head["t"][0] >= complete_until)

    def _expire(self, known: int) -> list[_Cluster]:
        """Remove and return the clusters whose tail can find no head any more."""
        horizon = self._scaled(known) - self._options.radius
        gone = [c for c in self._clusters.values() if c.ended and c.track is not None]
        gone = [c for c in gone if self._descriptor(c.tail)[2] <= horizon]
        for cluster in gone:
            del self._clusters[cluster.id]
        return gone

    def _deliver(self, settled: int, ended: list[_Cluster]) -> JoinedCorners:
        living = [c for c in self._clusters.values() if c.track is not None]
        parts, ids = [empty_events()], [np.empty(0, np.int64)]
        for cluster in living + ended:
            for part in cluster.undelivered:
                parts.append(part)
                ids.append(np.full(len(part), cluster.track, np.int64))
            cluster.undelivered = []
        for cluster in ended:
            self._complete_until.pop(cluster.track, None)  # type: ignore[arg-type]
        for cluster in living:
            # While a track waits for a successor it must not be declared complete beyond what it was before.
            if not cluster.ended:
                self._complete_until[cluster.track] = settled  # type: ignore[index]
        ended_ids = sorted(int(c.track) for c in ended)  # type: ignore[arg-type]
        return JoinedCorners(np.concatenate(parts), np.concatenate(ids), dict(self._complete_until), ended_ids)
