"""Errors of the command."""

from esfo_core.errors import EsfoError


class CommandError(EsfoError):
    """What was asked for cannot be done as asked."""
