"""Errors of the back-end."""

from esfo_core.errors import EsfoError


class BackendError(EsfoError):
    """The tracks do not allow an estimate; the message says why.

    flags: those of the verdict that name the cause.
    """

    def __init__(self, message: str, *flags: str) -> None:
        super().__init__(message)
        self.flags = flags


class StateError(EsfoError):
    """A saved state cannot be written or read."""
