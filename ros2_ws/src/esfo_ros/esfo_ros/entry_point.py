"""Start and end of a node process, and its exit code."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException

from esfo_core.errors import EsfoError


def run(make: Callable[[], Any], drive: Callable[[Any], None] = rclpy.spin) -> int:
    """Create a node, run `drive` on it and return the exit code of the process.

    0 after SIGINT, SIGTERM, a shutdown or when `drive` returns; 1, with one line on stderr, for an EsfoError in `make`,
    in a callback or in the node's `failure`. Any other exception is a bug and keeps its traceback.
    """
    node: Any = None
    try:
        # Some libraries (pycolmap) print a stack trace on SIGTERM, and rclpy would call their handler as well.
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


def _report(error: EsfoError) -> int:
    sys.stderr.write(f"error: {error}\n")
    return 1
