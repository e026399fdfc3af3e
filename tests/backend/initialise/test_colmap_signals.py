"""A process that has loaded pycolmap, in whatever thread, ends quietly on SIGTERM."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

PROGRAM = """
import os, signal, threading, time
signal.signal(signal.SIGTERM, signal.SIG_DFL)
thread = threading.Thread(target=lambda: __import__("esfo_backend.initialise.colmap"))
thread.start()
thread.join()
os.kill(os.getpid(), signal.SIGTERM)
time.sleep(10)
"""


def test_sigterm_is_quiet():
    pytest.importorskip("pycolmap")
    ended = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=60, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (-signal.SIGTERM, "", "")
