"""The part of FlatBuffers that AEDAT4 needs: fields of the root table of a buffer with its size in front."""

from __future__ import annotations

import struct

from esfo_core.errors import RecordingError


class RootTable:
    """The root table of `data`: size, position of the root, four letters of its kind, and so on.

    Raises RecordingError for another kind, and for any position outside `data`.
    """

    def __init__(self, data: bytes, kind: str) -> None:
        self._data = data
        found = data[8:12].decode("ascii", "replace")
        if found != kind:
            raise RecordingError(f"a block of kind {found!r} where {kind!r} belongs")
        self._root = 4 + self._number("<I", 4)
        self._fields = self._root - self._number("<i", self._root)

    def number(self, field: int, form: str, default: int) -> int:
        """Value of the scalar field number `field`, of the `struct` form `form`."""
        position = self._position(field)
        return default if position is None else self._number(form, position)

    def vector(self, field: int, item_size: int) -> bytes:
        """Bytes of the vector, or text, that is field number `field`; empty where there is none."""
        position = self._position(field)
        if position is None:
            return b""
        start = position + self._number("<I", position)
        size = self._number("<I", start) * item_size
        if start + 4 + size > len(self._data):
            raise RecordingError(f"a vector of {size} bytes in a block of {len(self._data)}")
        return self._data[start + 4 : start + 4 + size]

    def _position(self, field: int) -> int | None:
        entry = 4 + 2 * field
        if entry + 2 > self._number("<H", self._fields):
            return None
        offset = self._number("<H", self._fields + entry)
        return self._root + offset if offset else None

    def _number(self, form: str, position: int) -> int:
        if not 0 <= position <= len(self._data) - struct.calcsize(form):
            raise RecordingError(f"position {position} is outside of a block of {len(self._data)} bytes")
        return int(struct.unpack_from(form, self._data, position)[0])
