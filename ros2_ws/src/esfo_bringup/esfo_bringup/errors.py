"""Errors of the command."""

from esfo_core.errors import EsfoError


class CommandError(EsfoError):
    """What was asked for cannot be done as asked."""


def error_line(error: EsfoError) -> str:
    """Return the one line that the command prints for an error."""
    return f"esfo: {' '.join(str(error).split())}\n"
