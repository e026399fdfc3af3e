"""Errors of the back-end."""

from esfo_core.errors import EsfoError


class BackendError(EsfoError):
    """The tracks do not allow an estimate; the message says why.

    flags: names of what was found to be the cause, as in a verdict.
    """

    def __init__(self, message: str, *flags: str) -> None:
        super().__init__(message)
        self.flags = flags


class StateError(EsfoError):
    """A saved state cannot be written or read."""
