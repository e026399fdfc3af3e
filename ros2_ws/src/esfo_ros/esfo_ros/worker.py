"""A thread that does the heavy work of a node, so that its callbacks return at once."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Generic, TypeVar

from esfo_core.errors import EsfoError

T = TypeVar("T")

QUIET_S = 0.2
"""Time without a new item after which a request is served: messages sent before it have arrived by then."""

Request = tuple[Callable[[], str], Future[str]]


class StoppedError(EsfoError):
    """A request was not served, because the worker was stopped."""


class Worker(Generic[T]):
    """Processes items one after the other. When more than `capacity` items wait, the oldest is dropped and counted.

    capacity: may be changed at any time. dropped: number of items dropped so far. error: the exception that ended the
    thread, None while there is none. The thread sleeps while there is nothing to do, and can be started again after
    `stop`.
    """

    def __init__(self, work: Callable[[T], None], capacity: int, on_error: Callable[[], None] = lambda: None) -> None:
        """Prepare to call `work` for each item, and `on_error` once, in the thread, when `work` or a job raises."""
        self.capacity = capacity
        self.dropped = 0
        self.error: BaseException | None = None
        self._work, self._on_error = work, on_error
        self._items: deque[tuple[float, T]] = deque()
        self._requests: deque[Request] = deque()
        self._urgent: deque[Request] = deque()
        self._idle: Callable[[], object] = lambda: None
        self._idle_s = 0.0
        self._idle_due = False
        self._latest = time.monotonic()
        self._changed = threading.Condition()
        self._closed = True
        self._thread: threading.Thread | None = None

    @property
    def running(self) -> bool:
        """Whether it accepts items."""
        return not self._closed

    def start(self) -> None:
        """Start the thread; after `stop`, start it again."""
        self.stop()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="worker", daemon=True)
        self._thread.start()

    def stop(self, timeout: float | None = None) -> None:
        """End the thread after its current item and wait for it; waiting items are dropped and counted."""
        with self._changed:
            self._closed = True
            self.dropped += len(self._items)
            self._items.clear()
            requests = [*self._urgent, *self._requests]
            self._urgent.clear()
            self._requests.clear()
            self._idle_due = False
            self._changed.notify()
        for _, future in requests:
            future.set_exception(StoppedError("the node was deactivated"))
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(timeout)

    def when_idle(self, seconds: float, job: Callable[[], object]) -> None:
        """Call `job` once whenever no item arrives for `seconds` of wall time after the last one; 0: never."""
        self._idle_s, self._idle = seconds, job

    def put(self, item: T) -> None:
        """Add an item without blocking. While the worker is stopped, the item is dropped and counted."""
        with self._changed:
            if self._closed:
                self.dropped += 1
                return
            self._latest = time.monotonic()
            self._idle_due = True
            while len(self._items) >= self.capacity:
                self._items.popleft()
                self.dropped += 1
            self._items.append((self._latest, item))
            self._changed.notify()

    def request(self, job: Callable[[], str], after_quiet: bool = True) -> Future[str]:
        """Call `job` in the thread and return the future of its answer.

        after_quiet: call it when all items are processed and none has arrived for `QUIET_S`; otherwise before the next
        item. While the worker is stopped, no item can be waiting, and the job is called at once by the caller's thread.
        The future has the EsfoError that the job raises, or a StoppedError when the worker stops before.
        """
        future: Future[str] = Future()
        with self._changed:
            if not self._closed:
                (self._requests if after_quiet else self._urgent).append((job, future))
                self._changed.notify()
                return future
        _answer(job, future)
        return future

    def touch(self) -> None:
        """Note that a message arrived that needs no work; it delays requests and idle jobs as an item does."""
        self._latest = time.monotonic()
        if not self._idle_due:
            with self._changed:
                self._idle_due = True
                self._changed.notify()

    @property
    def age(self) -> float:
        """Time in s for which the oldest item has been waiting."""
        with self._changed:
            return time.monotonic() - self._items[0][0] if self._items else 0.0

    def _run(self) -> None:
        try:
            while not self._closed:
                self._step()
        except BaseException as error:  # noqa: BLE001 - the owner of the thread handles it
            self.error = error
            self._on_error()

    def _step(self) -> None:
        with self._changed:
            if not self._items and not self._urgent and not self._closed:
                self._changed.wait(self._until_due())
            urgent = self._urgent.popleft() if self._urgent else None
            item = self._items.popleft() if self._items and urgent is None else None
        if urgent is not None:
            _answer(*urgent)
        elif item is not None:
            self._work(item[1])
        elif not self._closed:
            self._when_quiet(time.monotonic() - self._latest)

    def _until_due(self) -> float | None:
        """Time in s until a request or the idle job is due if no item arrives; None for never."""
        quiet = time.monotonic() - self._latest
        waits = [QUIET_S - quiet] if self._requests else []
        if self._idle_due and self._idle_s > 0:
            waits.append(self._idle_s - quiet)
        return max(min(waits), 0.0) if waits else None

    def _when_quiet(self, quiet: float) -> None:
        if self._requests and quiet >= QUIET_S:
            _answer(*self._requests.popleft())
        elif self._idle_due and 0 < self._idle_s <= quiet:
            self._idle_due = False
            self._idle()


def _answer(job: Callable[[], str], future: Future[str]) -> None:
    try:
        future.set_result(job())
    except EsfoError as error:
        future.set_exception(error)
