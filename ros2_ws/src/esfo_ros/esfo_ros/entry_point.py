"""Start and end of a node process, and its exit code."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException

from esfo_core.errors import EsfoError
from esfo_ros.parameters import refuse_unknown


def run(make: Callable[[], Any], drive: Callable[[Any], None] = rclpy.spin) -> int:
    """Create a node, run `drive` on it and return the exit code of the process.

    0 after SIGINT, SIGTERM, a shutdown or when `drive` returns; 1, with one line on stderr, for arguments that ROS
    refuses, and for an EsfoError in `make`, in a callback or in what the node has as its `failure`. Any other exception
    is a bug: it keeps its traceback.
    """
    node: Any = None
    # Some libraries (pycolmap) answer SIGTERM with a stack trace; rclpy would still call such a handler.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        start_ros()
        node = make()
        refuse_unknown(node)
        drive(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except EsfoError as error:
        return _report(error)
    except Exception:
        if rclpy.ok():
            raise  # otherwise a signal arrived while the node was being created
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C must not interrupt the shutdown
        rclpy.try_shutdown()
        if hasattr(node, "close"):
            node.close()
    failure = getattr(node, "failure", None)
    if failure is None:
        return 0
    if isinstance(failure, EsfoError):
        return _report(failure)
    raise failure


def start_ros(args: list[str] | None = None) -> None:
    """Start ROS with the arguments of the process, or others. Raises EsfoError with the reason why it does not."""
    try:
        rclpy.init(args=args)
    except (RuntimeError, OSError, ValueError) as error:  # rcl's errors are RuntimeErrors, without a class of their own
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        reason = ": ".join(lines[:1]) or type(error).__name__
        hint = "; set HOME or ROS_LOG_DIR to a folder that can be written" if "logging" in reason else ""
        raise EsfoError(f"ROS does not start: {reason}{hint}") from error


def _report(error: EsfoError) -> int:
    sys.stderr.write(f"error: {error}\n")
    return 1
