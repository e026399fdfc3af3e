"""Errors of the back-end."""

from esfo_core.errors import EsfoError


class BackendError(EsfoError):
    """The tracks do not allow an estimate; the message says why."""
