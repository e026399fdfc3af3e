"""Processes of the nodes of a live run: their start, supervision and end."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType

from esfo_bringup.errors import CommandError

_GRACE_S = 5.0
_LOG_LINE = re.compile(r"\[\w+\] \[[\d.]+\] \[[\w./]+\]: ")


def find_executable(package: str, name: str) -> Path:
    """Find a node as `ros2 run` does. Raises CommandError when the workspace is not sourced."""
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        path = Path(prefix) / "lib" / package / name
        if prefix and path.is_file():
            return path
    raise CommandError(f"no {name} of {package} on AMENT_PREFIX_PATH: build and source the workspace")


class NodeProcess:
    """One node in its own process group; its output goes to a file."""

    def __init__(self, executable: Path, parameters: Mapping[str, object], folder: Path) -> None:
        self.name = executable.name
        self._log = folder / f"{executable.name}.log"
        arguments = ["--ros-args"]
        for key, value in parameters.items():
            arguments += ["-p", f"{key}:={str(value).lower() if isinstance(value, bool) else value}"]
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                [str(executable), *arguments], stdout=log, stderr=subprocess.STDOUT, start_new_session=True
            )

    @property
    def pid(self) -> int:
        """Identifier of its process."""
        return self._process.pid

    def exit_code(self) -> int | None:
        """Exit code, None while it runs."""
        return self._process.poll()

    def log(self) -> str:
        """Its output so far."""
        return self._log.read_text(errors="replace")

    def complaint(self) -> str:
        """The last line of its output, without the prefix of the ROS log."""
        lines = [line for line in self.log().splitlines() if line.strip()]
        last = _LOG_LINE.sub("", lines[-1]) if lines else "it printed nothing"
        return last.removeprefix("error: ")

    def signal_group(self, number: signal.Signals) -> None:
        """Send a signal to the whole group, which outlives its leader when that has children."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, number)

    def wait(self, until: float) -> bool:
        """Wait for its end until the time `until` of `time.monotonic`; return whether it ended."""
        try:
            self._process.wait(max(0.0, until - time.monotonic()))
        except subprocess.TimeoutExpired:
            return False
        return True


class NodeProcesses:
    """Nodes that are ended at the end of the `with` block: by SIGINT, then SIGTERM, then SIGKILL."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._nodes: list[NodeProcess] = []

    def start(self, package: str, name: str, parameters: Mapping[str, object]) -> NodeProcess:
        """Start a node."""
        node = NodeProcess(find_executable(package, name), parameters, self._folder)
        self._nodes.append(node)
        return node

    def check(self) -> None:
        """Raise CommandError, with its last line, when a node has died."""
        for node in self._nodes:
            code = node.exit_code()
            if code not in (None, 0):
                raise CommandError(f"{node.name} ended with exit code {code}: {node.complaint()}")

    def __enter__(self) -> NodeProcesses:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        running = self._nodes
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            running = [n for n in running if n.exit_code() is None]
            for node in running:
                node.signal_group(number)
            until = time.monotonic() + _GRACE_S
            running = [n for n in running if not n.wait(until)]
        for node in self._nodes:
            node.signal_group(signal.SIGKILL)
