"""A node of the tests: keeps what topics bring, calls services, sends events."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger

PATIENCE_S = 180.0  # the first run of all compiles the kernels
ANSWER_S = 20.0
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Listener:
    """Keeps every message of the topics it is told, the latest last."""

    def __init__(self, domain: int) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node("listener", context=self.context)
        self.executor = rclpy.executors.SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.got: dict[str, list[Any]] = {}

    def listen(self, kind: Any, topic: str, qos: QoSProfile | int = 10_000) -> list[Any]:
        """Keep the messages of a topic; return the list into which they come."""
        self.got[topic] = []
        self.node.create_subscription(kind, topic, self.got[topic].append, qos)
        return self.got[topic]

    def until(self, condition: Callable[[], object]) -> None:
        """Handle messages until the condition holds."""
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, {topic: (len(got), got[-1:]) for topic, got in self.got.items()}
            self.executor.spin_once(timeout_sec=0.05)

    def spin(self, seconds: float) -> None:
        """Handle messages for some time."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.05)

    def ask(self, kind: Any, service: str, request: Any) -> Any:
        """Return the answer of a service."""
        client = self.node.create_client(kind, service)
        calls: list[tuple[float, Any]] = []

        def answered() -> bool:
            # A node that discovers the client's reader too late cannot send its answer: ask again.
            if not calls or time.monotonic() > calls[-1][0] + ANSWER_S:
                calls.append((time.monotonic(), client.call_async(request)))
            return any(call.done() for _, call in calls)

        self.until(client.service_is_ready)
        self.until(answered)
        self.node.destroy_client(client)
        return next(call.result() for _, call in calls if call.done())

    def call(self, service: str) -> dict[str, str]:
        """Call a Trigger service, which has to succeed; return the pairs of its answer."""
        answer = self.ask(Trigger, service, Trigger.Request())
        assert answer.success, answer.message
        return dict(pair.split("=") for pair in answer.message.split() if "=" in pair)

    def set_parameter(self, node: str, name: str, value: object) -> str:
        """Set a parameter of another node; return why it was refused, empty when it was not."""
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        (result,) = self.ask(SetParameters, f"{node}/set_parameters", request).results
        return "" if result.successful else str(result.reason)

    def change_state(self, node: str, transition: int) -> str:
        """Take a lifecycle node through a transition, which has to succeed; return its state."""
        request = ChangeState.Request()
        request.transition.id = transition
        # A transition that was taken cannot be taken again, so it is not asked for twice.
        client = self.node.create_client(ChangeState, f"{node}/change_state")
        self.until(client.service_is_ready)
        self.spin(1.0)
        call = client.call_async(request)
        self.until(call.done)
        assert call.result().success
        self.node.destroy_client(client)
        return self.state(node)

    def state(self, node: str) -> str:
        """State of a lifecycle node."""
        return str(self.ask(GetState, f"{node}/get_state", GetState.Request()).current_state.label)

    def health(self, name: str) -> DiagnosticStatus | None:
        """Latest status of a node, by its full name."""
        if "/diagnostics" not in self.got:
            self.listen(DiagnosticArray, "/diagnostics")
        found = [m.status[0] for m in self.got["/diagnostics"] if m.status[0].name == name]
        return found[-1] if found else None

    def values(self, name: str) -> dict[str, str]:
        """What diagnostics of a node show from now on."""
        self.health(name)  # subscribes
        self.got["/diagnostics"].clear()
        self.until(lambda: self.health(name))
        status = self.health(name)
        assert status is not None
        return {pair.key: pair.value for pair in status.values}

    def close(self) -> None:
        """End the node."""
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.shutdown()
