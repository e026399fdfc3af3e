"""The `esfo` command."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from io import TextIOWrapper

from esfo_bringup import __version__
from esfo_bringup.commands import COMMANDS, add_command
from esfo_bringup.errors import error_line
from esfo_core.errors import EsfoError


def main(argv: list[str] | None = None) -> int:
    """Run one command and return the exit code: 0 on a result, 1 with one line on stderr on a known error."""
    parser = argparse.ArgumentParser(
        prog="esfo", description="Spin rate, axis and shape of a spinning object from an event camera."
    )
    parser.add_argument("--version", action="version", version=f"esfo {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name in _to_load(sys.argv[1:] if argv is None else argv):
        add_command(name, commands)
    args = parser.parse_args(argv)
    try:
        return int(args.execute(args))
    except EsfoError as error:
        sys.stderr.write(error_line(error))
        return 1
    except OSError as error:
        sys.stderr.write(f"esfo: {error.filename or 'a file'}: {error.strerror or error}\n")
        return 1
    except KeyboardInterrupt:
        sys.stderr.write("esfo: interrupted\n")
        return 130


def _to_load(argv: Sequence[str]) -> Sequence[str]:
    """Return the command that was asked for, else all: each imports modules that the others do not need."""
    return argv[:1] if argv and argv[0] in COMMANDS else COMMANDS


def console() -> None:
    """Entry point of the process; a reader that closes the pipe early is not an error."""
    # Importing pycolmap makes SIGTERM print a stack dump and abort.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    for stream in (sys.stdout, sys.stderr):  # names of files may be in another encoding than the terminal's
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        code = main()
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    sys.exit(code)
