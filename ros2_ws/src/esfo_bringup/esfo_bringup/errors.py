"""Errors of the command."""

from esfo_core.errors import EsfoError


class CommandError(EsfoError):
    """A command cannot be executed with these arguments."""


def error_line(error: EsfoError) -> str:
    """Return the one line that the command prints for an error."""
    return f"esfo: {' '.join(str(error).split())}\n"
