"""Which times of a stream are those of its clock: outliers are dropped, and a clock that was set back is told.

A stretch of events far from what came before waits. Where the stream then goes on as before, the stretch was an
outlier: a bit error of a clock, or a damaged word. Where the stretch itself goes on, it counts: ahead it follows a
pause without events, behind the clock was set back, and a new segment begins.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from esfo_core.codecs.base import MAX_STEP_BACK
from esfo_core.errors import RecordingError
from esfo_core.events import EventArray

ENOUGH_EVENTS = 50
ENOUGH_TIME = 2 * MAX_STEP_BACK
"""A stretch goes on when it has so many events over so many ns: damaged words reach less far."""

LEAST_START = MAX_STEP_BACK // 5
"""Time of as many events after which the start of a stream is no outlier, ns: damaged words reach over 4 ms."""

LEAST_RETURN = MAX_STEP_BACK // 5
"""Least step forward, ns, that leads from an outlier back to the stream rather than on from event to event."""

MOST_CONTRADICTIONS = 1000
"""Stretches that may wait, and outliers that may be most of the events: random times contradict each other."""

_SAMPLE = 1024  # events; pauses are looked for between them first


@dataclass
class _Stretch:
    """Events that go on from each other but not from those before. ahead: they are later than those, not earlier."""

    ahead: bool
    first: int = 0
    latest: int = 0
    count: int = 0
    parts: list[EventArray] = field(default_factory=list)

    def add(self, events: EventArray) -> None:
        if not self.count:
            self.first = int(events["t"][0])
        self.parts.append(events)
        self.count += len(events)
        self.latest = max(self.latest, int(events["t"][-1]))

    def lasts(self, duration: int) -> bool:
        return self.count >= ENOUGH_EVENTS and self.latest - self.first >= duration


class TimeCheck:
    """Passes on the events of a stream whose times hold, part by part, in the order of the stream.

    Events whose times never step back by more than `MAX_STEP_BACK` all pass. Memory: the stretches that wait, each of
    them shorter than `ENOUGH_TIME` or `ENOUGH_EVENTS`.
    outliers: events dropped so far.
    """

    def __init__(self) -> None:
        self.outliers = 0
        self._count = 0
        self._latest: int | None = None  # of the events passed on
        self._waiting: list[_Stretch] = []
        self._start: _Stretch | None = _Stretch(True)

    def goes_on(self, events: EventArray) -> bool:
        """Take time-sorted events (N,) where all of them go on from those before, as nearly always; return whether.

        Where they do not, nothing has changed.
        """
        if not len(events):
            return True
        if self._waiting or self._start is not None or self._latest is None:
            return False
        first, last = events["t"][0].item(), events["t"][-1].item()
        if last - first > MAX_STEP_BACK or abs(first - self._latest) > MAX_STEP_BACK:
            return False
        self._count += len(events)
        self._latest = max(self._latest, last)
        return True

    def push(self, events: EventArray) -> Iterator[tuple[EventArray, bool]]:
        """Take the next time-sorted events (N,); yield parts that hold, each with whether a new segment begins there.

        Raises RecordingError where most times contradict each other.
        """
        if self.goes_on(events):
            yield events, False
            return
        self._count += len(events)
        for run in _runs(events):
            for part, anew in self._push_run(run):
                yield from self._released(part, anew)

    def flush(self) -> Iterator[tuple[EventArray, bool]]:
        """Yield what waits: no event follows."""
        for part, anew in self._settle():
            yield from self._released(part, anew)
        yield from self._release_start()

    def _released(self, part: EventArray, anew: bool) -> Iterator[tuple[EventArray, bool]]:
        """Hold the start of the stream back until it has gone on: it may be an outlier itself."""
        if anew:
            yield from self._release_start()
        if self._start is None:
            yield part, anew
            return
        self._start.add(part)
        if self._start.lasts(LEAST_START):
            yield from self._release_start()

    def _release_start(self) -> Iterator[tuple[EventArray, bool]]:
        parts, self._start = [] if self._start is None else self._start.parts, None
        for part in parts:
            yield part, False

    def _push_run(self, run: EventArray) -> Iterator[tuple[EventArray, bool]]:
        first = int(run["t"][0])
        if self._waiting and self._returns(first):
            self._drop(self._waiting)
            self._waiting = []
        if self._latest is None or (not self._waiting and abs(first - self._latest) <= MAX_STEP_BACK):
            yield self._passed(run), False
            return
        if not self._waiting or first < self._waiting[-1].latest - MAX_STEP_BACK:
            if len(self._waiting) == MOST_CONTRADICTIONS:
                self._refuse()
            self._waiting.append(_Stretch(first > self._latest))
        self._waiting[-1].add(run)
        if self._waiting[-1].lasts(ENOUGH_TIME):
            yield from self._settle()

    def _returns(self, t: int) -> bool:
        """Whether the time `t` goes on from the events passed on, rather than from those that wait."""
        stretch = self._waiting[-1]
        assert self._latest is not None
        if t < self._latest - MAX_STEP_BACK:
            return False
        if stretch.ahead:
            return t < stretch.latest - MAX_STEP_BACK
        return t - stretch.latest > max(LEAST_RETURN, abs(t - self._latest))

    def _settle(self) -> Iterator[tuple[EventArray, bool]]:
        """Decide about what waits, and yield what holds of it."""
        waiting, self._waiting = self._waiting, []
        if self._start is not None and _is_outlier(self._start, waiting):
            self._drop([self._start])
            self._start, self._latest = _Stretch(True), None
        for i, stretch in enumerate(waiting):
            if stretch.ahead or self._latest is None:
                for part in stretch.parts:
                    yield self._passed(part), False
            elif any(later.ahead for later in waiting[i + 1 :]) or stretch.count == 1:
                self._drop([stretch])
            elif stretch.latest >= self._latest:  # it has caught up: the clock was not set back
                yield from self._caught_up(stretch)
            else:
                self._latest = None
                for k, part in enumerate(stretch.parts):
                    yield self._passed(part), k == 0

    def _caught_up(self, stretch: _Stretch) -> Iterator[tuple[EventArray, bool]]:
        """Drop what is too late to be sorted in; yield the rest."""
        assert self._latest is not None
        begin = self._latest - MAX_STEP_BACK
        for part in stretch.parts:
            late = int(np.searchsorted(part["t"], begin))
            self.outliers += late
            if late < len(part):
                yield self._passed(part[late:]), False

    def _drop(self, stretches: list[_Stretch]) -> None:
        self.outliers += sum(stretch.count for stretch in stretches)
        if self.outliers > MOST_CONTRADICTIONS and 2 * self.outliers > self._count:
            self._refuse()

    def _refuse(self) -> None:
        raise RecordingError(
            f"the times of {self.outliers} of {self._count} events contradict those around them: no times of events"
        )

    def _passed(self, events: EventArray) -> EventArray:
        last = int(events["t"][-1])
        self._latest = last if self._latest is None else max(self._latest, last)
        return events


def without_outliers(parts: list[EventArray]) -> tuple[list[EventArray], int]:
    """Check the parts of one packet by themselves: those whose times hold, and the number of events dropped.

    So a live stream does not wait for the next packet; an outlier at the end of its packet is not found.
    Raises RecordingError as `TimeCheck`.
    """
    check = TimeCheck()
    checked = [pair for part in parts for pair in check.push(part)] + list(check.flush())
    joined: list[list[EventArray]] = []
    for part, anew in checked:
        if anew or not joined:
            joined.append([])
        joined[-1].append(part)
    return [_sorted(together) for together in joined], check.outliers


def _sorted(parts: list[EventArray]) -> EventArray:
    together = np.concatenate(parts)
    return together[np.argsort(together["t"], kind="stable")] if len(parts) > 1 else parts[0]


def _is_outlier(start: _Stretch, later: list[_Stretch]) -> bool:
    """Whether the start of a stream is one: what follows is behind it, and it is a lone event or is caught up with."""
    if not later or any(stretch.ahead for stretch in later):
        return False
    return start.count == 1 or later[-1].latest >= start.latest


def _runs(events: EventArray) -> list[EventArray]:
    """Cut time-sorted events (N,), N > 0, at pauses longer than `MAX_STEP_BACK`."""
    t = events["t"]
    samples = np.append(np.arange(0, len(t), _SAMPLE), len(t) - 1)
    cuts: list[int] = []
    for k in np.flatnonzero(np.diff(t[samples]) > MAX_STEP_BACK):
        start, end = int(samples[k]), int(samples[k + 1]) + 1
        cuts += (np.flatnonzero(np.diff(t[start:end]) > MAX_STEP_BACK) + start + 1).tolist()
    return np.split(events, cuts) if cuts else [events]
