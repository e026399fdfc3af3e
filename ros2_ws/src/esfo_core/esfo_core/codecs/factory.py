"""Which decoder reads which encoding."""

from __future__ import annotations

from esfo_core.codecs.base import Decoder
from esfo_core.codecs.mono import MonoDecoder
from esfo_core.errors import RecordingError

_DECODERS: dict[str, type[Decoder]] = {
    "mono": MonoDecoder,
}

ENCODINGS = tuple(sorted(_DECODERS))
"""Names of the encodings that `decoder` knows."""


def decoder(encoding: str, width: int, height: int) -> Decoder:
    """Return a fresh decoder of `encoding` for a sensor of width x height pixels.

    Raises RecordingError for an unknown encoding or a sensor without pixels.
    """
    if encoding not in _DECODERS:
        raise RecordingError(f"unknown event encoding {encoding!r}; known: {', '.join(ENCODINGS)}")
    return _DECODERS[encoding](width, height)
