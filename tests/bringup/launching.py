"""What the launch file starts, where `launch` is installed: in place of each node a note of its start is written."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml
from launch.actions import IncludeLaunchDescription, SetLaunchConfiguration
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import PushRosNamespace

from launch import LaunchDescription, LaunchService

LAUNCH_FILE = Path(__file__).parents[2] / "ros2_ws/src/esfo_bringup/launch/esfo.launch.py"
PATIENCE_S = 30.0
STAND_IN = """#!{python}
import json, os, signal, sys
files = [open(b).read() for a, b in zip(sys.argv, sys.argv[1:]) if a == "--params-file"]
path = "{folder}/%d" % os.getpid()
with open(path, "w") as note:
    json.dump([sys.argv[1:], files], note)
os.rename(path, path + ".json")
signal.signal(signal.SIGINT, lambda *_: sys.exit(0))
signal.pause()
"""


@dataclass(frozen=True)
class Started:
    """One node that was started: its remapping rules, `__ns` among them, its parameters and all its arguments."""

    remappings: dict[str, str]
    parameters: dict[str, Any]
    arguments: list[str]


def started(
    folder: Path, expected: int, pushed_namespace: str = "", expected_result: int = 0, **arguments: str
) -> dict[str, Started]:
    """Launch with stand-ins for `expected` nodes, below a namespace if there is one; return them by executable."""
    stand_in = folder / "stand_in"
    stand_in.write_text(STAND_IN.format(python=sys.executable, folder=folder))
    stand_in.chmod(0o755)
    service = LaunchService(argv=[])
    service.include_launch_description(
        LaunchDescription(
            [
                SetLaunchConfiguration("launch-prefix", str(stand_in)),
                *([PushRosNamespace(pushed_namespace)] if pushed_namespace else []),
                IncludeLaunchDescription(
                    PythonLaunchDescriptionSource(str(LAUNCH_FILE)), launch_arguments=arguments.items()
                ),
            ]
        )
    )
    threading.Thread(target=_end_when_started, args=(service, folder, expected)).start()
    assert service.run() == expected_result
    notes = [json.loads(path.read_text()) for path in folder.glob("*.json")]
    assert len(notes) == expected, notes
    return {Path(words[0]).name: _parsed(words[1:], files) for words, files in notes}


def _end_when_started(service: LaunchService, folder: Path, expected: int) -> None:
    end = time.monotonic() + PATIENCE_S
    while len(list(folder.glob("*.json"))) < expected and time.monotonic() < end:
        time.sleep(0.02)
    time.sleep(0.1)  # for a node too many
    service.shutdown()


def _parsed(words: list[str], files: list[str]) -> Started:
    pairs = [b.partition(":=") for a, b in pairwise(words) if a == "-r"]
    parameters: dict[str, Any] = {}
    for text in files:
        for block in yaml.safe_load(text).values():
            parameters.update(block["ros__parameters"])
    return Started({name: value for name, _, value in pairs}, parameters, words)


def add_package(folder: Path, name: str) -> str:
    """Make a prefix with an empty package of one executable; return AMENT_PREFIX_PATH with it."""
    for part in ("share/ament_index/resource_index/packages", f"lib/{name}"):
        (folder / part).mkdir(parents=True)
        (folder / part / name).touch(0o755)
    return os.pathsep.join([str(folder), os.environ["AMENT_PREFIX_PATH"]])
