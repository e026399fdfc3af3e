"""What every node shares: parameters made from options, services that take their time, an orderly start and end.

ROS is needed by modules called `node.py` or `messages.py` alone, here as in the other packages.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import Future
from typing import Any, TypeVar

import rclpy
import rclpy.task
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_srvs.srv import Trigger

from esfo_core.errors import EsfoError, OptionError
from esfo_core.messages import parameter_descriptor
from esfo_core.options import OptionField, fields_of, replace

T = TypeVar("T")


def declare_fields(node: Node, options: T, read_only: bool = True) -> T:
    """Declare every field of an options dataclass as a parameter; return the options as they are set.

    Raises OptionError for a bad value.
    """
    return replace(options, {leaf.name: declare(node, leaf, read_only) for leaf in fields_of(options)})


def declare_options(node: Node, presets: Mapping[str, T], read_only: bool = True) -> T:
    """Declare `preset` and every field of its options; fields that are not set have the value of the preset.

    Raises OptionError for an unknown preset or a bad value.
    """
    leaf = OptionField("preset", "default", "values of the options that are not set", None, None, tuple(presets))
    preset = declare(node, leaf, read_only=True)
    if preset not in presets:
        raise OptionError(f"preset is {preset!r}; choose from {', '.join(presets)}")
    return declare_fields(node, presets[preset], read_only)


def declare(node: Node, leaf: OptionField, read_only: bool) -> Any:
    """Declare one option as a parameter and return its value. Raises OptionError for a bad value."""
    try:
        value = node.declare_parameter(leaf.name, leaf.value, parameter_descriptor(leaf, read_only)).value
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        raise OptionError(f"parameter {leaf.name}: {error}") from error
    check_type(leaf, value)
    return value


def check_type(leaf: OptionField, value: object) -> None:
    """Raise OptionError when a parameter has another type than its option; whole numbers serve as fractions too."""
    allowed = (int, float) if isinstance(leaf.value, float) else (type(leaf.value),)
    if type(value) not in allowed:
        raise OptionError(f"parameter {leaf.name} takes {type(leaf.value).__name__}, got {value!r}")


def with_values(options: T, values: Mapping[str, object]) -> T:
    """Return options with the values of those parameters that are fields of them.

    Raises OptionError for a bad value.
    """
    mine = {leaf.name: leaf for leaf in fields_of(options) if leaf.name in values}
    for name, leaf in mine.items():
        check_type(leaf, values[name])
    return replace(options, {name: values[name] for name in mine})


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


def run(make: Callable[[], Any], drive: Callable[[Any], None] = rclpy.spin) -> int:
    """Make a node, drive it to its end and return the exit code of the process.

    0 after SIGINT, SIGTERM, a shutdown or when `drive` returns; 1, with one line on stderr, for an EsfoError in `make`,
    in a callback or in what the node has as its `failure`. Any other exception is a bug: it keeps its traceback.
    """
    node: Any = None
    try:
        # Some libraries (pycolmap) answer SIGTERM with a stack trace; rclpy would still call such a handler.
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        rclpy.init()
        node = make()
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
        if hasattr(node, "close"):
            node.close()
    failure = getattr(node, "failure", None)
    if failure is None:
        return 0
    if isinstance(failure, EsfoError):
        return _report(failure)
    raise failure


def _report(error: EsfoError) -> int:
    sys.stderr.write(f"error: {error}\n")
    return 1
