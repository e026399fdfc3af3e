"""Reader of CDR, the serialised form of ROS 2 messages, for the types of fields in messages of events."""

from __future__ import annotations

import struct
from functools import cache

from esfo_core.errors import RecordingError

ENCAPSULATION = 4
"""Bytes before the fields: the kind of CDR in two, options in the others."""

PADDING = 3
"""Most bytes that may follow the last field: writers fill up to a multiple of 4."""

_BYTE_ORDERS = {b"\0\0": ">", b"\0\1": "<"}


class CdrReader:
    """Reads the fields of one message, encapsulation header included, in their order.

    byte_order: "<" or ">", of the fields. Every method raises RecordingError where the message ends too early.

    Source: OMG DDS-XTypes 1.3, 7.4.1 and 7.6.3.1.2, encoding version 1: fields are aligned to their size, counted from
    the end of the header.
    """

    def __init__(self, data: bytes) -> None:
        """Take a message. Raises RecordingError unless it says that it is plain CDR."""
        kind = bytes(data[:2])
        if len(data) < ENCAPSULATION or kind not in _BYTE_ORDERS:
            raise RecordingError(f"a message that begins with 0x{bytes(data[:ENCAPSULATION]).hex()} is no plain CDR")
        self.byte_order = _BYTE_ORDERS[kind]
        self._data = memoryview(data)
        self._position = ENCAPSULATION

    def numbers(self, codes: str, align: int) -> tuple[int, ...]:
        """Return adjacent numbers, given as characters of `struct`, the first of them aligned to `align` bytes."""
        layout = _layout(self.byte_order + codes)
        start = self._position + (ENCAPSULATION - self._position) % align
        self._need(start + layout.size)
        self._position = start + layout.size
        return layout.unpack_from(self._data, start)

    def bytes(self, count: int) -> memoryview:
        """Return the next bytes, without copying them."""
        start = self._position
        self._need(start + count)
        self._position += count
        return self._data[start : start + count]

    def text(self) -> str:
        """Return a string. Raises RecordingError where it is not UTF-8."""
        (length,) = self.numbers("I", 4)
        raw = bytes(self.bytes(length)).rstrip(b"\0")
        try:
            return raw.decode()
        except UnicodeDecodeError as error:
            raise RecordingError(f"a string of the message is no text: {raw[:20]!r}") from error

    def finish(self) -> None:
        """Raise RecordingError where more follows than padding."""
        extra = len(self._data) - self._position
        if extra > PADDING:
            raise RecordingError(f"{extra} bytes follow the last field of the message")

    def _need(self, end: int) -> None:
        if end > len(self._data):
            raise RecordingError(f"the message has {len(self._data)} bytes, but its fields need {end} or more")


@cache
def _layout(codes: str) -> struct.Struct:
    return struct.Struct(codes)
