"""Decoders and encoders by the name of the encoding."""

from __future__ import annotations

from collections.abc import Callable

from esfo_core.codecs.base import Decoder
from esfo_core.codecs.dat import DatDecoder
from esfo_core.codecs.event_array import BigEndianCdrEventArrayDecoder, CdrEventArrayDecoder, Ros1EventArrayDecoder
from esfo_core.codecs.evt2 import Evt2Decoder
from esfo_core.codecs.evt3 import Evt3Decoder
from esfo_core.codecs.evt3_encoder import Evt3Encoder
from esfo_core.codecs.evt21 import Evt21Decoder, Evt21LegacyDecoder
from esfo_core.codecs.libcaer import LibcaerDecoder
from esfo_core.codecs.libcaer_cmp import LibcaerCmpDecoder
from esfo_core.codecs.mono import MonoDecoder, encode_mono
from esfo_core.errors import RecordingError
from esfo_core.events import EventArray

_DECODERS: dict[str, type[Decoder]] = {
    "cdr_event_array": CdrEventArrayDecoder,
    "cdr_event_array_be": BigEndianCdrEventArrayDecoder,
    "dat": DatDecoder,
    "evt2": Evt2Decoder,
    "evt21": Evt21Decoder,
    "evt21_legacy": Evt21LegacyDecoder,
    "evt3": Evt3Decoder,
    "libcaer": LibcaerDecoder,
    "libcaer_cmp": LibcaerCmpDecoder,
    "mono": MonoDecoder,
    "ros1_event_array": Ros1EventArrayDecoder,
}

ENCODINGS = tuple(_DECODERS)
"""Names of the encodings that `decoder` knows: those of `EventPacket`, of Prophesee files, and of older messages."""


WRITABLE = ("mono", "evt3")
"""Names of the encodings that `encoder` knows."""


def decoder(encoding: str, width: int, height: int) -> Decoder:
    """Return a fresh decoder of `encoding` for a sensor of width x height pixels.

    Raises RecordingError for an unknown encoding or a sensor without pixels.
    """
    if encoding not in _DECODERS:
        raise RecordingError(f"unknown event encoding {encoding!r}; known: {', '.join(ENCODINGS)}")
    return _DECODERS[encoding](width, height)


def encoder(encoding: str, round_times: bool = False) -> Callable[[EventArray], tuple[int, bytes]]:
    """Return a function that encodes the events (N,), N > 0, of the next packet as its time base in ns and its data.

    round_times: round times down to what the encoding holds (`evt3`: microseconds) instead of refusing others.

    Raises RecordingError for an encoding that cannot be written.
    """
    if encoding == "evt3":
        return Evt3Encoder(round_times).encode
    if encoding == "mono":
        return lambda events: (int(events["t"][0]), encode_mono(events, int(events["t"][0])))
    raise RecordingError(f"the encoding {encoding!r} cannot be written; choose from {', '.join(WRITABLE)}")
