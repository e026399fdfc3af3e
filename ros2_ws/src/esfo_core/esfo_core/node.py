"""What the nodes share: parameters made from options, time stamps, diagnostics, an orderly start and end.

With `node.py` and `messages.py` of the other packages this is the only module that needs ROS.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import Future
from typing import Any, TypeVar

import rclpy
import rclpy.task
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_srvs.srv import Trigger

from esfo_core.errors import EsfoError, OptionError
from esfo_core.options import OptionField, fields_of, replace
from esfo_core.worker import Worker

T = TypeVar("T")

SECOND = 1_000_000_000


def declare_fields(node: Node, options: T) -> T:
    """Declare every field of an options dataclass as a read-only parameter; return the options as they are set.

    Raises OptionError for a bad value.
    """
    return replace(options, {leaf.name: _declare(node, leaf) for leaf in fields_of(options)})


def declare_options(node: Node, presets: Mapping[str, T]) -> T:
    """Declare `preset` and every field of its options; fields that are not set have the value of the preset.

    Raises OptionError for an unknown preset or a bad value.
    """
    leaf = OptionField("preset", "default", "values of the options that are not set", None, None, tuple(presets))
    preset = _declare(node, leaf)
    if preset not in presets:
        raise OptionError(f"preset is {preset!r}; choose from {', '.join(presets)}")
    return declare_fields(node, presets[preset])


def _declare(node: Node, leaf: OptionField) -> Any:
    # Typed dynamically, so that `300` is taken where `300.0` is meant: rclpy would refuse it.
    descriptor = ParameterDescriptor(
        description=leaf.meaning,
        read_only=True,
        dynamic_typing=True,
        additional_constraints=f"one of: {', '.join(leaf.choices)}" if leaf.choices else "",
    )
    low = -sys.float_info.max if leaf.low is None else leaf.low
    high = sys.float_info.max if leaf.high is None else leaf.high
    if leaf.low is not None or leaf.high is not None:
        if isinstance(leaf.value, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
        else:
            bounds = [round(max(min(v, 2.0**62), -(2.0**62))) for v in (low, high)]
            descriptor.integer_range = [IntegerRange(from_value=bounds[0], to_value=bounds[1], step=1)]
    try:
        value = node.declare_parameter(leaf.name, leaf.value, descriptor).value
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        raise OptionError(f"parameter {leaf.name}: {error}") from error
    allowed = (int, float) if isinstance(leaf.value, float) else (type(leaf.value),)
    if type(value) not in allowed:
        raise OptionError(f"parameter {leaf.name} takes {type(leaf.value).__name__}, got {value!r}")
    return value


def to_stamp(ns: int) -> Time:
    """Return nanoseconds as a ROS time. Raises EsfoError for a time that ROS cannot express."""
    seconds, nanoseconds = divmod(ns, SECOND)
    if not 0 <= seconds < 2**31:
        raise EsfoError(f"time {ns} ns does not fit a ROS time stamp")
    return Time(sec=seconds, nanosec=nanoseconds)


def from_stamp(stamp: Time) -> int:
    """Return a ROS time in nanoseconds."""
    return int(stamp.sec) * SECOND + int(stamp.nanosec)


def diagnostics(node: Node, problem: str, values: Mapping[str, object]) -> DiagnosticArray:
    """Build a diagnostic message of one status: OK when `problem` is empty, else a warning that says it."""
    status = DiagnosticStatus(
        level=DiagnosticStatus.WARN if problem else DiagnosticStatus.OK,
        name=node.get_fully_qualified_name(),
        message=problem or "ok",
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
    message = DiagnosticArray(status=[status])
    message.header.stamp = node.get_clock().now().to_msg()
    return message


def trigger(
    node: Node, submit: Callable[[], Future[str]]
) -> Callable[[Trigger.Request, Trigger.Response], Awaitable[Trigger.Response]]:
    """Return a service callback that answers with what `submit` promises, without holding up other callbacks."""

    async def handle(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        answer = rclpy.task.Future(executor=node.executor)
        answer.add_done_callback(lambda _: None)  # without a callback the executor would not wake up
        submit().add_done_callback(lambda done: answer.set_result(done.result()))
        response.message = await answer
        response.success = True
        return response

    return handle


def start_worker(node: Node, work: Callable[[T], None], capacity: int) -> Worker[T]:
    """Start a worker of which a failure shuts the node's context down, so that `run` reports it."""

    def fail() -> None:
        if not node.context.ok():
            worker.error = None  # it only tried to publish while the node was being shut down
        node.context.try_shutdown()

    worker = Worker(work, capacity, fail)
    worker.start()
    return worker


def run(make: Callable[[], Node], drive: Callable[[Any], None] = rclpy.spin) -> int:
    """Make a node, drive it to its end and return the exit code of the process.

    0 after SIGINT, SIGTERM, a shutdown or when `drive` returns; 1, with one line on stderr, for an EsfoError in `make`,
    in a callback or in the `worker` that the node may have. Any other exception is a bug: it keeps its traceback.
    """
    worker: Worker[Any] | None = None
    try:
        # Some libraries (pycolmap) answer SIGTERM with a stack trace; rclpy would still call such a handler.
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        rclpy.init()
        node = make()
        worker = getattr(node, "worker", None)
        drive(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except EsfoError as error:
        return _report(error)
    except Exception:
        if rclpy.ok():
            raise  # otherwise a signal came while the node was being made
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C must not interrupt the orderly end
        rclpy.try_shutdown()
        if worker is not None:
            worker.close()
    if worker is None or worker.error is None:
        return 0
    if isinstance(worker.error, EsfoError):
        return _report(worker.error)
    raise worker.error


def _report(error: EsfoError) -> int:
    sys.stderr.write(f"error: {error}\n")
    return 1
