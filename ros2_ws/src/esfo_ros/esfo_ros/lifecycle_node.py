"""Base class of the front-end node and the back-end node: life cycle, parameters, diagnostics, one worker thread.

Life cycle (design.ros2.org/articles/node_lifecycle): configure creates the worker, the publishers and the services,
activate subscribes, deactivate unsubscribes and keeps the state of the stream, cleanup frees everything.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, ClassVar, Generic, TypeVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from esfo_core.errors import EsfoError, OptionError
from esfo_core.options import OptionField
from esfo_ros.connected_node import STEADY, ConnectedNode
from esfo_ros.diagnostics import diagnostic_message
from esfo_ros.parameters import declare, declare_fields, declare_options, with_values
from esfo_ros.reminder import Reminder
from esfo_ros.services import Service
from esfo_ros.topics import Topic
from esfo_ros.worker import Worker

Options = TypeVar("Options")
Live = TypeVar("Live")

DIAGNOSE_S = 1.0
REPEAT_S = 10.0
"""Time after which a persistent problem is logged again."""

_AUTOSTART = OptionField(
    "autostart", True, "configure and activate at the start, without a lifecycle manager", None, None, ()
)


class ManagedNode(ConnectedNode, Generic[Options, Live]):
    """A lifecycle node whose parameters are the fields of its options and can be set at any time.

    options: of the algorithm, live: of the node itself, both with the current parameters. state: unconfigured,
    inactive, active or finalized. worker: does the work, in a thread, while the node is active; None while it is
    unconfigured.

    Subclasses implement the methods from `check` to `values`. A transition fails when one of them raises, and the error
    is logged.
    """

    INPUTS: ClassVar[tuple[Topic, ...]] = ()
    OUTPUTS: ClassVar[tuple[Topic, ...]] = ()
    SERVICES: ClassVar[tuple[Service, ...]] = ()

    def __init__(self, name: str, presets: Mapping[str, Options], live: Live) -> None:
        """Declare all parameters. Raises OptionError for a bad value."""
        super().__init__(name)
        self.state = "unconfigured"
        self.worker: Worker[Any] | None = None
        self.autostart = declare(self, _AUTOSTART, read_only=True)
        self.options: Options = declare_options(self, presets, read_only=False)
        self.live: Live = declare_fields(self, live, read_only=False)
        self.check(self.options)
        self._error: Exception | None = None
        self._reminder = Reminder(REPEAT_S)
        self._health = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_timer(DIAGNOSE_S, self._diagnose, clock=STEADY)
        self.add_on_set_parameters_callback(self._validate)
        self.add_post_set_parameters_callback(self._apply)

    # For subclasses to implement.

    def check(self, options: Options) -> None:
        """Raise OptionError for options that contradict each other."""

    def configure(self) -> Worker[Any]:
        """Create what processes the data, and return the worker that calls it."""
        raise NotImplementedError

    def activate(self) -> None:
        """Subscribe with `subscribe` and start timers with `tick`; the worker is already running."""
        raise NotImplementedError

    def clean_up(self) -> None:
        """Free what `configure` created, and the state of the stream."""
        raise NotImplementedError

    def reconfigure(self) -> None:
        """Apply changed `options` and `live`; called by the worker, only while the node is configured."""
        raise NotImplementedError

    def jobs(self) -> dict[str, Callable[[], str]]:
        """Return, by the names of `SERVICES`, jobs for the worker that return the answer."""
        return {}

    def problems(self) -> dict[str, str]:
        """Return the present problems, a short text by kind; called once a second while the node is active."""
        return {}

    def values(self) -> dict[str, object]:
        """Return the values that /diagnostics shows while the node is configured."""
        return {}

    def make_worker(self, work: Callable[[Any], None], capacity: int) -> Worker[Any]:
        """Return a worker whose failure ends the process, so that `run` reports it."""

        def fail() -> None:
            if worker.error is not None:
                self._fail(worker.error)

        worker: Worker[Any] = Worker(work, capacity, fail)
        return worker

    # The process.

    def spin(self) -> None:
        """Configure and activate the node where `autostart` is set, then handle callbacks.

        Raises the error of a transition that failed.
        """
        if self.autostart:
            for transition in (self.trigger_configure, self.trigger_activate):
                if transition() != TransitionCallbackReturn.SUCCESS:
                    raise self._error or EsfoError(f"{self.get_name()} could not start")
        rclpy.spin(self)

    def close(self) -> None:
        """Stop receiving and end the current work, before the process ends."""
        self._close_raw()
        if self.worker is not None:
            self.worker.stop(timeout=10.0)

    # Transitions, called by rclpy.

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Create the publishers, the worker and the services."""
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
        """Unsubscribe and end the current work; the state of the stream is kept."""
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
        """Call the steps of a transition and log what they raise, which rclpy does not."""
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
        self._advertise(self.OUTPUTS)
        self.worker = self.configure()
        self._serve(self.SERVICES, self.jobs(), self.worker)

    def _activate(self) -> None:
        if self.worker is not None:
            self.worker.start()
        self.activate()

    def _halt(self) -> None:
        if self.worker is not None:
            self.worker.stop()  # first, because its work may use what is destroyed next
        self._disconnect()

    def _free(self) -> None:
        self._halt()
        self._withdraw()
        self.worker = None
        self.clean_up()

    # Parameters.

    def _validate(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            options, _ = self._changed(parameters)
            self.check(options)
        except OptionError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter]) -> None:
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
