"""One thread that does the heavy work of a node, so that its callbacks return at once."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Generic, TypeVar

T = TypeVar("T")

POLL_S = 0.02
QUIET_S = 0.2
"""Time without a new item after which a request is served: what was sent before it has arrived by then."""


class Worker(Generic[T]):
    """Works on items one after the other. When more than `capacity` wait, the oldest is dropped and counted.

    dropped: items dropped so far. error: what ended the work, None while all is well.
    """

    def __init__(self, work: Callable[[T], None], capacity: int, on_error: Callable[[], None] = lambda: None) -> None:
        """Prepare to call `work` for each item, and `on_error` once, in the thread, when anything raises."""
        self.dropped = 0
        self.error: BaseException | None = None
        self._work, self._capacity, self._on_error = work, capacity, on_error
        self._items: deque[tuple[float, T]] = deque()
        self._requests: deque[tuple[Callable[[], str], Future[str]]] = deque()
        self._idle: Callable[[], object] = lambda: None
        self._idle_s = 0.0
        self._idle_due = False
        self._latest = time.monotonic()
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="worker", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def when_idle(self, seconds: float, job: Callable[[], object]) -> None:
        """Do `job` once whenever `seconds` of wall time have passed after an item and none followed; 0 is never."""
        self._idle_s, self._idle = seconds, job

    def put(self, item: T) -> None:
        """Add an item; never waits."""
        with self._changed:
            self._latest = time.monotonic()
            self._idle_due = True
            if len(self._items) >= self._capacity:
                self._items.popleft()
                self.dropped += 1
            self._items.append((self._latest, item))
            self._changed.notify()

    def request(self, job: Callable[[], str]) -> Future[str]:
        """Do `job` in the thread when all items are done and none has come for `QUIET_S`; return its future answer."""
        future: Future[str] = Future()
        with self._changed:
            self._requests.append((job, future))
        return future

    def touch(self) -> None:
        """Note that something arrived that needs no work: it puts off requests and idle jobs like an item."""
        self._latest = time.monotonic()
        self._idle_due = True

    @property
    def age(self) -> float:
        """Seconds that the oldest item has been waiting."""
        with self._changed:
            return time.monotonic() - self._items[0][0] if self._items else 0.0

    def close(self, timeout: float = 10.0) -> None:
        """End the thread after its current item, forget the others, and wait for it up to `timeout` seconds."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join(timeout)

    def _run(self) -> None:
        try:
            while not self._closed:
                self._step()
        except BaseException as error:  # noqa: BLE001 - whoever started the thread decides what to do with it
            self.error = error
            self._on_error()

    def _step(self) -> None:
        with self._changed:
            if not self._items:
                self._changed.wait(POLL_S)
            item = self._items.popleft() if self._items else None
        if item is not None:
            self._work(item[1])
        else:
            self._when_quiet(time.monotonic() - self._latest)

    def _when_quiet(self, quiet: float) -> None:
        if self._requests and quiet >= QUIET_S:
            job, future = self._requests.popleft()
            future.set_result(job())
        elif self._idle_due and 0 < self._idle_s <= quiet:
            self._idle_due = False
            self._idle()
