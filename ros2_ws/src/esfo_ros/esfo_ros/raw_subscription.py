"""A subscription whose messages are received in a separate thread.

rclpy's executor examines every entity of a node after each message. This takes about a millisecond of interpreter time,
as much as the processing of a 4 ms packet. Here a thread waits for one subscription only.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node

from esfo_ros.topics import Topic

WAIT_NS = 500_000_000


class NoExecutor(CallbackGroup):  # type: ignore[misc]
    """Callback group that no executor serves."""

    def can_execute(self, _entity: object) -> bool:
        """Return false: no entity of this group is ready for an executor."""
        return False

    def beginning_execution(self, _entity: object) -> bool:
        """Return false."""
        return False

    def ending_execution(self, _entity: object) -> None:
        """Do nothing."""


class RawSubscription:
    """A subscription to serialised messages, with its own thread. topic_name: the full name of its topic.

    The thread waits as `rclpy.wait_for_message` does, without a time limit.
    """

    def __init__(
        self, node: Node, topic: Topic, callback: Callable[[bytes], None], on_error: Callable[[BaseException], None]
    ) -> None:
        """Subscribe, and call `callback` with each serialised message, in the thread, until `close`.

        on_error: called once, in the thread, with the error of the callback or of the waiting, which ends the thread.
        """
        self._node, self._callback, self._on_error = node, callback, on_error
        self._subscription = node.create_subscription(
            topic.kind, topic.name, callback, topic.qos, callback_group=NoExecutor(), raw=True
        )
        self.topic_name = self._subscription.topic_name
        self._wake = node.create_guard_condition(lambda: None, callback_group=NoExecutor())
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="raw_subscription", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and the subscription."""
        self._closed = True
        if self._node.context.ok():  # otherwise the thread has ended
            self._wake.trigger()
        self._thread.join()
        self._node.destroy_subscription(self._subscription)
        self._node.destroy_guard_condition(self._wake)

    def _run(self) -> None:
        try:
            self._serve()
        except BaseException as error:  # noqa: BLE001 - the owner of the thread handles it
            if self._node.context.ok():  # otherwise the wait ended because the node was being shut down
                self._on_error(error)

    def _serve(self) -> None:
        with self._subscription.handle, self._wake.handle:
            wait_set = _rclpy.WaitSet(1, 1, 0, 0, 0, 0, self._node.context.handle)
            while not self._closed and self._node.context.ok():
                wait_set.clear_entities()
                wait_set.add_subscription(self._subscription.handle)
                wait_set.add_guard_condition(self._wake.handle)
                wait_set.wait(WAIT_NS)
                self._take_all()

    def _take_all(self) -> None:
        while not self._closed:
            taken = self._subscription.handle.take_message(self._subscription.msg_type, True)
            if taken is None:
                return
            self._callback(taken[0])
