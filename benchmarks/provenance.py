"""The line above every table: which command measured it, of which commit, when and on which machine."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def print_provenance() -> None:
    """Print command, commit, date, processor with load, and Python as one line of Markdown."""
    arguments = " ".join(sys.argv[1:])
    command = f"python benchmarks/{Path(sys.argv[0]).name} {arguments}".strip()
    cores = f"{os.cpu_count()} x {processor()} (load {os.getloadavg()[0]:.1f})"
    python = f"Python {platform.python_version()}"
    print(f"`{command}`, commit {commit()}, {datetime.now(UTC):%Y-%m-%d}, {cores}, {python}\n", flush=True)


def commit() -> str:
    """Return the commit of the working copy, and whether files differ from it; `unknown` outside of one."""
    try:
        name = _git("rev-parse", "--short", "HEAD")
        return f"{name} with local changes" if _git("status", "--porcelain", "--", "ros2_ws", "benchmarks") else name
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def processor() -> str:
    """Return the model of the processor, as Linux names it."""
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        name, _, value = line.partition(":")
        if name.strip() == "model name":
            return " ".join(value.split())
    return platform.machine()


def _git(*arguments: str) -> str:
    asked = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    return asked.stdout.strip()
