"""The sub-commands of `esfo`, one module each, imported on demand: each loads modules that others do not need."""

from __future__ import annotations

import argparse

COMMANDS = ("simulate", "info", "convert", "run", "live", "evaluate", "benchmark")


def add_command(name: str, commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command `name`, one of COMMANDS, with its arguments."""
    match name:
        case "simulate":
            from esfo_bringup.commands.simulate import add_to
        case "info":
            from esfo_bringup.commands.info import add_to
        case "convert":
            from esfo_bringup.commands.convert import add_to
        case "run":
            from esfo_bringup.commands.run import add_to
        case "live":
            from esfo_bringup.commands.live import add_to
        case "evaluate":
            from esfo_bringup.commands.evaluate import add_to
        case "benchmark":
            from esfo_bringup.commands.benchmark import add_to
        case _:
            raise ValueError(f"no command {name!r}; there are {', '.join(COMMANDS)}")
    add_to(commands)
