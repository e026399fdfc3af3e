"""Nodes that cannot start say why in one line and end with 1."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytest.importorskip("rclpy", reason="no ROS here")

NODE = "import sys; from esfo_frontend.ros.node import main; sys.exit(main())"


def start(*arguments, **environment):
    env = {**os.environ, **environment}
    command = [sys.executable, "-c", NODE, "--ros-args", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, env=env)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--params-file", "nix.yaml"], "nix.yaml"),
        (["-r", "bogus"], "bogus"),
        (["-p", "association.gat:=3.0"], "no parameter association.gat (is association.gate meant?)"),
    ],
)
def test_refused_arguments(arguments, reason, ros_domain):
    ended = start(*arguments)
    assert ended.returncode == 1
    assert reason in ended.stderr.splitlines()[-1]
    assert ended.stderr.splitlines()[-1].startswith("error: ")
    assert "Traceback" not in ended.stderr


def test_a_folder_for_logs_that_cannot_be_written(tmp_path, ros_domain):
    (tmp_path / "file").write_text("")
    ended = start(ROS_LOG_DIR=str(tmp_path / "file" / "log"))
    assert ended.returncode == 1
    assert "set HOME or ROS_LOG_DIR" in ended.stderr.splitlines()[-1]
