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
    """One service of a node, of type std_srvs/Trigger, and what it does.

    after_quiet: it waits until everything that is on the way has been worked on; otherwise it comes next.
    """

    name: str
    meaning: str
    after_quiet: bool


def trigger(
    node: Node, submit: Callable[[], Future[str]]
) -> Callable[[Trigger.Request, Trigger.Response], Awaitable[Trigger.Response]]:
    """Return a service callback that answers with what `submit` promises, without holding up other callbacks.

    An EsfoError is the answer of a call that did not succeed.
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
