"""Services of the nodes, all of type std_srvs/Trigger."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from dataclasses import dataclass

import rclpy.task
from rclpy.node import Node
from std_srvs.srv import Trigger


@dataclass(frozen=True)
class Service:
    """One service of a node, of type std_srvs/Trigger.

    meaning: what it does and answers. after_quiet: it is served after all messages that are queued or in transit;
    otherwise before the next message.
    """

    name: str
    meaning: str
    after_quiet: bool


def trigger(
    node: Node, submit: Callable[[], Future[str]]
) -> Callable[[Trigger.Request, Trigger.Response], Awaitable[Trigger.Response]]:
    """Return a service callback that answers with the result of `submit`, without blocking other callbacks.

    An EsfoError becomes the message of an unsuccessful response.
    """

    async def handle(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        answer = rclpy.task.Future(executor=node.executor)
        answer.add_done_callback(lambda _: None)  # without a callback the executor would not wake up
        submit().add_done_callback(answer.set_result)
        done: Future[str] = await answer
        error = done.exception()
        response.success, response.message = error is None, str(error or done.result())
        return response

    return handle
