"""The worker thread: order, the bound of its queue, requests after everything, idle jobs and failures."""

import threading
import time

import pytest

from esfo_ros.worker import QUIET_S, Worker

PATIENCE_S = 10.0


@pytest.fixture
def gate():
    return threading.Event()


@pytest.fixture
def worker_on():
    started = []

    def make(work, capacity=100, on_error=lambda: None):
        worker = Worker(work, capacity, on_error)
        worker.start()
        started.append(worker)
        return worker

    yield make
    for worker in started:
        worker.stop()


def test_items_are_done_in_order_and_a_request_after_them(worker_on):
    done = []
    worker = worker_on(done.append)
    for i in range(50):
        worker.put(i)
    answer = worker.request(lambda: f"after {len(done)}")
    assert answer.result(PATIENCE_S) == "after 50"
    assert done == list(range(50))
    assert worker.dropped == 0


def test_a_full_queue_drops_its_oldest_items_and_counts_them(worker_on, gate):
    done = []
    entered = threading.Event()

    def work(item):
        done.append(item)
        entered.set()
        gate.wait(PATIENCE_S)

    worker = worker_on(work, capacity=3)
    worker.put(0)
    assert entered.wait(PATIENCE_S)
    for i in range(1, 8):
        worker.put(i)
    assert worker.age > 0
    gate.set()
    worker.request(lambda: "").result(PATIENCE_S)
    assert done == [0, 5, 6, 7]
    assert worker.dropped == 4
    assert worker.age == 0


def test_a_request_waits_for_what_is_still_arriving(worker_on):
    done = []
    worker = worker_on(done.append)
    answer = worker.request(lambda: f"{len(done)}")
    for i in range(5):
        worker.put(i)
        time.sleep(QUIET_S / 2)
    assert answer.result(PATIENCE_S) == "5"


@pytest.mark.parametrize("arrive", ["put", "touch"])
def test_an_idle_job_is_done_once_per_pause(worker_on, arrive):
    idle = []
    worker = worker_on(lambda _: None)
    worker.when_idle(0.1, lambda: idle.append(time.monotonic()))
    time.sleep(0.3)
    assert idle == []  # nothing has arrived yet
    for count in (1, 2):
        before = time.monotonic()
        worker.put(1) if arrive == "put" else worker.touch()
        time.sleep(0.5)
        assert len(idle) == count
        assert idle[-1] - before >= 0.1


def test_a_failure_ends_the_work_and_is_kept(worker_on):
    failed = threading.Event()
    worker = worker_on(lambda item: 1 // item, on_error=failed.set)
    worker.put(1)
    worker.put(0)
    assert failed.wait(PATIENCE_S)
    assert isinstance(worker.error, ZeroDivisionError)
    worker.stop()


def test_closing_forgets_what_waits(worker_on, gate):
    done = []
    entered = threading.Event()

    def work(item):
        entered.set()
        gate.wait(PATIENCE_S)
        done.append(item)

    worker = worker_on(work)
    worker.put(0)
    worker.put(1)
    entered.wait(PATIENCE_S)
    threading.Timer(0.2, gate.set).start()
    worker.stop()
    assert done == [0]
