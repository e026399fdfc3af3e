"""Connections of a lifecycle node: publishers, subscriptions, timers and services, and why a topic does not connect."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import partial
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from std_srvs.srv import Trigger

from esfo_core.errors import OptionError
from esfo_ros.raw_subscription import RawSubscription
from esfo_ros.services import Service, trigger
from esfo_ros.topics import Topic, mismatch
from esfo_ros.worker import Worker

STEADY = Clock(clock_type=ClockType.STEADY_TIME)

_OVERRIDES = QoSOverridingOptions(
    (QoSPolicyKind.DEPTH, QoSPolicyKind.DURABILITY, QoSPolicyKind.HISTORY, QoSPolicyKind.RELIABILITY)
)


class ConnectedNode(LifecycleNode):  # type: ignore[misc]
    """A lifecycle node that keeps account of its connections.

    Publishers and services exist while the node is configured, subscriptions and timers while it is active.

    failure: the error that ended the process, None while there is none.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.failure: BaseException | None = None
        self._inputs: dict[str, tuple[Any, QoSProfile]] = {}
        self._latched: list[Any] = []
        self._outputs: dict[str, Any] = {}
        self._services_made: list[Any] = []
        self._ticks: list[Any] = []

    # For subclasses.

    def publish(self, topic: str, message: Any) -> None:
        """Publish on one of `OUTPUTS`; while the node is not active, the message is discarded."""
        output = self._outputs.get(topic)
        if output is not None:
            output.publish(message)

    def listeners(self, topic: str) -> int:
        """Return the number of subscriptions to one of `OUTPUTS`."""
        return int(self._outputs[topic].get_subscription_count()) if topic in self._outputs else 0

    def subscribe(self, topic: Topic, callback: Callable[[Any], None]) -> None:
        """Subscribe until the node is deactivated."""
        profile = copy(topic.qos)  # rclpy writes overrides into it
        make = partial(self.create_subscription, topic.kind, topic.name, callback, profile)
        self._inputs[topic.name] = (_with_overrides(make), profile)

    def subscribe_raw(self, topic: Topic, callback: Callable[[bytes], None]) -> None:
        """Receive serialised messages in a separate thread until the node is deactivated.

        Replaces an earlier subscription to the topic. Parameters cannot override the quality of service.
        """
        self._unsubscribe(topic.name)
        self._inputs[topic.name] = (RawSubscription(self, topic, callback, self._fail), topic.qos)

    def subscribe_latched_or_not(self, topic: Topic, callback: Callable[[Any], None]) -> None:
        """Subscribe to a latched topic, and also receive what publishers that do not latch send from now on.

        Messages that a latched publisher sends later arrive twice.
        """
        self.subscribe(topic, callback)
        subscription, profile = self._inputs[topic.name]
        volatile = copy(profile)
        volatile.durability = DurabilityPolicy.VOLATILE
        # The volatile subscription connects with every publisher that the latched one connects with: it alone is
        # checked for publishers with another quality of service.
        self._inputs[topic.name] = (self.create_subscription(topic.kind, topic.name, callback, volatile), volatile)
        self._latched.append(subscription)

    def tick(self, seconds: float, job: Callable[[], None], clock: Clock = STEADY) -> Any:
        """Call `job` every `seconds` until the node is deactivated; return the timer."""
        self._ticks.append(self.create_timer(seconds, job, clock=clock))
        return self._ticks[-1]

    def remedy(self, topic: str) -> str:
        """Return which parameter changes the quality of service that this node requests for one of `INPUTS`."""
        return f"set qos_overrides.{self._inputs[topic][0].topic_name}.subscription.* of this node"

    # For the life cycle.

    def _advertise(self, topics: Sequence[Topic]) -> None:
        """Create the publishers."""
        for topic in topics:
            make = partial(self.create_lifecycle_publisher, topic.kind, topic.name, copy(topic.qos))
            self._outputs[topic.name] = _with_overrides(make)

    def _serve(self, services: Sequence[Service], jobs: Mapping[str, Callable[[], str]], worker: Worker[Any]) -> None:
        """Create the services; the worker does the job of each, by its name."""
        for service in services:
            submit = partial(worker.request, jobs[service.name], service.after_quiet)
            self._services_made.append(self.create_service(Trigger, service.name, trigger(self, submit)))

    def _disconnect(self) -> None:
        """Destroy timers and subscriptions."""
        for timer in self._ticks:
            self.destroy_timer(timer)
        self._ticks.clear()
        for name in list(self._inputs):
            self._unsubscribe(name)
        for subscription in self._latched:
            self.destroy_subscription(subscription)
        self._latched.clear()

    def _withdraw(self) -> None:
        """Destroy services and publishers."""
        for service in self._services_made:
            self.destroy_service(service)
        self._services_made.clear()
        for output in self._outputs.values():
            self.destroy_lifecycle_publisher(output)
        self._outputs.clear()

    def _close_raw(self) -> None:
        """End the threads of raw subscriptions."""
        for subscription, _ in self._inputs.values():
            if isinstance(subscription, RawSubscription):
                subscription.close()

    def _unsubscribe(self, name: str) -> None:
        subscription, _ = self._inputs.pop(name, (None, None))
        if isinstance(subscription, RawSubscription):
            subscription.close()
        elif subscription is not None:
            self.destroy_subscription(subscription)

    def _fail(self, error: BaseException) -> None:
        """End the process, so that `run` reports the error."""
        if self.context.ok():  # otherwise the error comes from publishing while the node was being shut down
            self.failure = error
        self.context.try_shutdown()

    def _unconnected(self) -> dict[str, str]:
        """Return, by topic, which other node does not connect with this one, and what would help."""
        found = {}
        for name, (subscription, qos) in self._inputs.items():
            for other in self.get_publishers_info_by_topic(subscription.topic_name):
                why = mismatch(other.qos_profile, qos)
                if why:
                    found[name] = f"{name} of {other.node_name} does not arrive: {why}; {self.remedy(name)}"
        for name, output in self._outputs.items():
            for other in self.get_subscriptions_info_by_topic(output.topic_name):
                why = mismatch(output.qos_profile, other.qos_profile)
                if why:
                    remedy = f"set qos_overrides.{output.topic_name}.publisher.* of this node, or QoS of the subscriber"
                    found[name] = f"{name} does not reach {other.node_name}: {why}; {remedy}"
        return found


def _with_overrides(make: Callable[..., Any]) -> Any:
    """Create a publisher or subscription whose quality of service parameters can override."""
    try:
        return make(qos_overriding_options=_OVERRIDES)
    except (InvalidQosOverridesError, KeyError, ValueError, TypeError) as error:
        raise OptionError(f"a parameter below qos_overrides is wrong: {error}") from error
