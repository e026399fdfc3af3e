"""Decoders and encoders of event data, by the name that `event_camera_msgs/EventPacket` gives the encoding."""

from esfo_core.codecs.base import MAX_STEP_BACK, TRIGGER_DTYPE, Decoder, DecoderStatistics
from esfo_core.codecs.factory import ENCODINGS, WRITABLE, decoder, encoder
from esfo_core.codecs.mono import encode_mono

__all__ = [
    "ENCODINGS",
    "MAX_STEP_BACK",
    "TRIGGER_DTYPE",
    "WRITABLE",
    "Decoder",
    "DecoderStatistics",
    "decoder",
    "encode_mono",
    "encoder",
]
