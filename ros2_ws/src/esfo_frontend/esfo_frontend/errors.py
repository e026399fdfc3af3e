"""Errors of the front-end."""

from esfo_core.errors import EsfoError


class FrontendError(EsfoError):
    """Events are not a stream of this sensor: time goes back, or a pixel or polarity is impossible."""
