"""Errors of the front-end."""

from esfo_core.errors import EsfoError


class FrontendError(EsfoError):
    """Events do not form one stream of this sensor: back in time, outside the image, or not a polarity."""
