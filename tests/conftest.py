"""What several tests need: a ROS domain of their own and processes that always end."""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

SPEC_PORT, PORTS_PER_DOMAIN, FIRST_UNICAST = 7400, 250, 10
HIGHEST_DOMAIN = 101  # above, the ports of a domain overlap those that Linux hands out
END_S = 20.0


def free_domain() -> int:
    """Return a ROS domain in which no participant of this machine lives, by the port that the first one takes."""
    for domain in random.sample(range(1, HIGHEST_DOMAIN + 1), HIGHEST_DOMAIN):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", SPEC_PORT + PORTS_PER_DOMAIN * domain + FIRST_UNICAST))
            except OSError:
                continue
            return domain
    raise RuntimeError("every ROS domain of this machine is in use")


@pytest.fixture(scope="session")
def session_domain() -> int:
    """A ROS domain for what several tests share."""
    return free_domain()


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> int:
    """A ROS domain of this test alone, set for this process and its children, which do not leave this machine."""
    domain = free_domain()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    return domain


@pytest.fixture
def start() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start processes that get SIGINT at the end of the test; each must then end by itself with exit code 0."""
    started: list[subprocess.Popen[str]] = []

    def begin(*command: str | Path) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [str(part) for part in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=os.environ
        )
        started.append(process)
        return process

    yield begin
    for process in started:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
    ends = [_end(process) for process in started]
    assert not any(ends), "\n".join(ends)


def _end(process: subprocess.Popen[str]) -> str:
    """Wait for a process; return what is wrong with its end, nothing if all is well."""
    try:
        output, _ = process.communicate(timeout=END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        output, _ = process.communicate()
        return f"{process.args} did not end within {END_S} s of SIGINT:\n{output}"
    return "" if process.returncode == 0 else f"{process.args} ended with {process.returncode}:\n{output}"
