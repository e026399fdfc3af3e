"""Which decoder reads which encoding."""

from __future__ import annotations

from esfo_core.codecs.base import Decoder
from esfo_core.codecs.dat import DatDecoder
from esfo_core.codecs.event_array import CdrEventArrayDecoder, Ros1EventArrayDecoder
from esfo_core.codecs.evt2 import Evt2Decoder
from esfo_core.codecs.evt3 import Evt3Decoder
from esfo_core.codecs.libcaer import LibcaerDecoder
from esfo_core.codecs.libcaer_cmp import LibcaerCmpDecoder
from esfo_core.codecs.mono import MonoDecoder
from esfo_core.errors import RecordingError

_DECODERS: dict[str, type[Decoder]] = {
    "cdr_event_array": CdrEventArrayDecoder,
    "dat": DatDecoder,
    "evt2": Evt2Decoder,
    "evt3": Evt3Decoder,
    "libcaer": LibcaerDecoder,
    "libcaer_cmp": LibcaerCmpDecoder,
    "mono": MonoDecoder,
    "ros1_event_array": Ros1EventArrayDecoder,
}

ENCODINGS = tuple(_DECODERS)
"""Names of the encodings that `decoder` knows: those of `EventPacket`, of Prophesee files, and of older messages."""


def decoder(encoding: str, width: int, height: int) -> Decoder:
    """Return a fresh decoder of `encoding` for a sensor of width x height pixels.

    Raises RecordingError for an unknown encoding or a sensor without pixels.
    """
    if encoding not in _DECODERS:
        raise RecordingError(f"unknown event encoding {encoding!r}; known: {', '.join(ENCODINGS)}")
    return _DECODERS[encoding](width, height)
