"""Base of the front-end's and the back-end's node: life cycle, live parameters, diagnostics, one worker thread.

Life cycle (REP 2000, design.ros2.org/articles/node_lifecycle): configure makes what the parameters ask for, activate
subscribes, deactivate keeps all that was learnt, cleanup frees it.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from copy import copy
from functools import partial
from typing import Any, ClassVar, Generic, TypeVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from std_srvs.srv import Trigger

from esfo_core.errors import EsfoError, OptionError
from esfo_core.options import OptionField
from esfo_ros.diagnostics import diagnostic_message
from esfo_ros.parameters import declare, declare_fields, declare_options, with_values
from esfo_ros.raw_subscription import RawSubscription
from esfo_ros.reminder import Reminder
from esfo_ros.services import Service, trigger
from esfo_ros.topics import Topic, mismatch
from esfo_ros.worker import Worker

Options = TypeVar("Options")
Live = TypeVar("Live")

STEADY = Clock(clock_type=ClockType.STEADY_TIME)
DIAGNOSE_S = 1.0
REPEAT_S = 10.0
"""Time after which a problem that goes on is logged again."""

_AUTOSTART = OptionField(
    "autostart", True, "configure and activate at the start, without a lifecycle manager", None, None, ()
)
_OVERRIDES = QoSOverridingOptions(
    (QoSPolicyKind.DEPTH, QoSPolicyKind.DURABILITY, QoSPolicyKind.HISTORY, QoSPolicyKind.RELIABILITY)
)


class ManagedNode(LifecycleNode, Generic[Options, Live]):  # type: ignore[misc]
    """A lifecycle node whose parameters are the fields of its options and can be set at any time.

    options, live: what the parameters say now; live are those of the node itself. state: unconfigured, inactive or
    active. worker: does the work while the node is active; None while it is unconfigured. failure: what ended the
    worker, None while all is well.

    Subclasses fill in the steps below. What these raise lets the transition fail, and the log says why.
    """

    INPUTS: ClassVar[tuple[Topic, ...]] = ()
    OUTPUTS: ClassVar[tuple[Topic, ...]] = ()
    SERVICES: ClassVar[tuple[Service, ...]] = ()

    def __init__(self, name: str, presets: Mapping[str, Options], live: Live) -> None:
        """Declare all parameters. Raises OptionError for a bad value."""
        super().__init__(name)
        self.state = "unconfigured"
        self.worker: Worker[Any] | None = None
        self.failure: BaseException | None = None
        self.autostart = declare(self, _AUTOSTART, read_only=True)
        self.options: Options = declare_options(self, presets, read_only=False)
        self.live: Live = declare_fields(self, live, read_only=False)
        self.check(self.options)
        self._error: Exception | None = None
        self._inputs: dict[str, tuple[Any, QoSProfile]] = {}
        self._latched: list[Any] = []
        self._outputs: dict[str, Any] = {}
        self._triggers: list[Any] = []
        self._ticks: list[Any] = []
        self._reminder = Reminder(REPEAT_S)
        self._health = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_timer(DIAGNOSE_S, self._diagnose, clock=STEADY)
        self.add_on_set_parameters_callback(self._judge)
        self.add_post_set_parameters_callback(self._take_over)

    # What a node fills in.

    def check(self, options: Options) -> None:
        """Raise OptionError for options that contradict each other."""

    def configure(self) -> Worker[Any]:
        """Make what does the work, and the worker for it."""
        raise NotImplementedError

    def activate(self) -> None:
        """Subscribe, with `subscribe`, and start what `tick`s; the worker runs already."""
        raise NotImplementedError

    def clean_up(self) -> None:
        """Free what was made and learnt."""
        raise NotImplementedError

    def reconfigure(self) -> None:
        """Go on with changed `options` and `live`; only called while configured, where the worker works."""
        raise NotImplementedError

    def jobs(self) -> dict[str, Callable[[], str]]:
        """Return what each of `SERVICES` does: a job for the worker, that returns the answer."""
        return {}

    def problems(self) -> dict[str, str]:
        """Return what is wrong, one short text for each kind; called once a second while active."""
        return {}

    def values(self) -> dict[str, object]:
        """Return what diagnostics show while the node is configured."""
        return {}

    # What a node uses.

    def publish(self, topic: str, message: Any) -> None:
        """Publish on one of `OUTPUTS`; nothing leaves while the node is not active."""
        output = self._outputs.get(topic)
        if output is not None:
            output.publish(message)

    def listeners(self, topic: str) -> int:
        """Return how many subscribe to one of `OUTPUTS`."""
        return int(self._outputs[topic].get_subscription_count()) if topic in self._outputs else 0

    def subscribe(self, topic: Topic, callback: Callable[[Any], None]) -> None:
        """Subscribe until the node is deactivated."""
        profile = copy(topic.qos)  # rclpy writes overrides into it
        make = partial(self.create_subscription, topic.kind, topic.name, callback, profile)
        self._inputs[topic.name] = (self._with_overrides(make), profile)

    def take_in(self, topic: Topic, callback: Callable[[bytes], None]) -> None:
        """Subscribe until the node is deactivated, or to the topic of this name once more, in a thread of its own.

        The callback gets serialised messages. Parameters cannot override the quality of service.
        """
        self._unsubscribe(topic.name)
        self._inputs[topic.name] = (RawSubscription(self, topic, callback, self._fail), topic.qos)

    def subscribe_latched_or_not(self, topic: Topic, callback: Callable[[Any], None]) -> None:
        """Subscribe to a latched topic so that publishers which do not latch are heard too, from now on.

        What a latched publisher sends later comes twice.
        """
        self.subscribe(topic, callback)
        subscription, profile = self._inputs[topic.name]
        volatile = copy(profile)
        volatile.durability = DurabilityPolicy.VOLATILE
        # This one connects with whatever the first does: it alone is looked at for ends that do not match.
        self._inputs[topic.name] = (self.create_subscription(topic.kind, topic.name, callback, volatile), volatile)
        self._latched.append(subscription)

    def tick(self, seconds: float, job: Callable[[], None], clock: Clock = STEADY) -> Any:
        """Call `job` again and again until the node is deactivated; return the timer."""
        self._ticks.append(self.create_timer(seconds, job, clock=clock))
        return self._ticks[-1]

    def make_worker(self, work: Callable[[Any], None], capacity: int) -> Worker[Any]:
        """Return a worker whose failure ends the process, so that `run` reports it."""

        def fail() -> None:
            if worker.error is not None:
                self._fail(worker.error)

        worker: Worker[Any] = Worker(work, capacity, fail)
        return worker

    # The process.

    def spin(self) -> None:
        """Configure and activate if the node has to do so by itself, and serve. Raises what made that fail."""
        if self.autostart:
            for transition in (self.trigger_configure, self.trigger_activate):
                if transition() != TransitionCallbackReturn.SUCCESS:
                    raise self._error or EsfoError(f"{self.get_name()} could not start")
        rclpy.spin(self)

    def close(self) -> None:
        """End the work that is under way; the process is about to end."""
        for subscription, _ in self._inputs.values():
            if isinstance(subscription, RawSubscription):
                subscription.close()
        if self.worker is not None:
            self.worker.stop(timeout=10.0)

    # Transitions, called by rclpy.

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make publishers, services and what does the work."""
        result = self._attempt(self._configure, partial(super().on_configure, state))
        if result == TransitionCallbackReturn.SUCCESS:
            self.state = "inactive"
        else:
            self._free()
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Enable the publishers and subscribe."""
        result = self._attempt(partial(super().on_activate, state), self._activate)
        if result == TransitionCallbackReturn.SUCCESS:
            self.state = "active"
        else:
            self._halt()
            super().on_deactivate(state)
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Unsubscribe and end the work that is under way; all that was learnt is kept."""
        self.state = "inactive"
        return self._attempt(self._halt, partial(super().on_deactivate, state))

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Free everything."""
        self.state = "unconfigured"
        return self._attempt(self._free, partial(super().on_cleanup, state))

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Free everything; only the end of the process can follow."""
        self.state = "finalized"
        return self._attempt(self._free, partial(super().on_shutdown, state))

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Free everything after a bug, so that the node can be configured again."""
        self.state = "unconfigured"
        return self._attempt(self._free, partial(super().on_error, state))

    def _attempt(self, *steps: Callable[[], Any]) -> TransitionCallbackReturn:
        """Take steps; rclpy itself would be silent about what they raise."""
        self._error = None
        try:
            for step in steps:
                step()
        except EsfoError as error:
            self._error = error
            if self.state != "unconfigured" or not self.autostart:  # otherwise `spin` raises it
                self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        except Exception as error:  # noqa: BLE001 - the state machine has a state for it
            self._error = error
            self.get_logger().error(traceback.format_exc())
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS

    def _configure(self) -> None:
        for topic in self.OUTPUTS:
            make = partial(self.create_lifecycle_publisher, topic.kind, topic.name, copy(topic.qos))
            self._outputs[topic.name] = self._with_overrides(make)
        self.worker = self.configure()
        jobs = self.jobs()
        for service in self.SERVICES:
            submit = partial(self.worker.request, jobs[service.name], service.after_quiet)
            self._triggers.append(self.create_service(Trigger, service.name, trigger(self, submit)))

    def _activate(self) -> None:
        if self.worker is not None:
            self.worker.start()
        self.activate()

    def _halt(self) -> None:
        if self.worker is not None:
            self.worker.stop()  # the first, since it may use what is destroyed next
        for timer in self._ticks:
            self.destroy_timer(timer)
        self._ticks.clear()
        for name in list(self._inputs):
            self._unsubscribe(name)
        for subscription in self._latched:
            self.destroy_subscription(subscription)
        self._latched.clear()

    def _unsubscribe(self, name: str) -> None:
        subscription, _ = self._inputs.pop(name, (None, None))
        if isinstance(subscription, RawSubscription):
            subscription.close()
        elif subscription is not None:
            self.destroy_subscription(subscription)

    def _fail(self, error: BaseException) -> None:
        """End the process, so that `run` reports the error."""
        if self.context.ok():  # otherwise it only tried to publish while the node was being shut down
            self.failure = error
        self.context.try_shutdown()

    def _free(self) -> None:
        self._halt()
        for service in self._triggers:
            self.destroy_service(service)
        self._triggers.clear()
        for output in self._outputs.values():
            self.destroy_lifecycle_publisher(output)
        self._outputs.clear()
        self.worker = None
        self.clean_up()

    def _with_overrides(self, make: Callable[..., Any]) -> Any:
        try:
            return make(qos_overriding_options=_OVERRIDES)
        except (InvalidQosOverridesError, KeyError, ValueError, TypeError) as error:
            raise OptionError(f"a parameter below qos_overrides is wrong: {error}") from error

    # Parameters.

    def _judge(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            options, _ = self._changed(parameters)
            self.check(options)
        except OptionError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take_over(self, parameters: list[Parameter]) -> None:
        before = (self.options, self.live)
        self.options, self.live = self._changed(parameters)
        if self.worker is not None and before != (self.options, self.live):
            self.worker.request(self._reconfigure, after_quiet=False)

    def _reconfigure(self) -> str:
        self.reconfigure()
        return "done"

    def _changed(self, parameters: list[Parameter]) -> tuple[Options, Live]:
        values = {parameter.name: parameter.value for parameter in parameters}
        return with_values(self.options, values), with_values(self.live, values)

    # Diagnostics.

    def _diagnose(self) -> None:
        problems = self.problems() | self._unconnected() if self.state == "active" else {}
        if self._reminder.due(frozenset(problems)):
            self.get_logger().warning("; ".join(problems.values()))
        values = {"state": self.state} | (self.values() if self.state in ("active", "inactive") else {})
        stamp = self.get_clock().now().to_msg()
        self._health.publish(diagnostic_message(self.get_fully_qualified_name(), stamp, problems, values))

    def _unconnected(self) -> dict[str, str]:
        """Say for every topic which other end does not connect with this node, and what would help."""
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
                    remedy = f"set qos_overrides.{output.topic_name}.publisher.* of this node, or what the other asks"
                    found[name] = f"{name} does not reach {other.node_name}: {why}; {remedy}"
        return found

    def remedy(self, topic: str) -> str:
        """Say which parameter changes what this node asks of the publishers of one of `INPUTS`."""
        return f"set qos_overrides.{self._inputs[topic][0].topic_name}.subscription.* of this node"
