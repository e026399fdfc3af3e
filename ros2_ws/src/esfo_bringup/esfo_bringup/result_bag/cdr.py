"""CDR serialisation (XCDR1, little-endian) of ROS messages, by the field types of their classes.

`rclpy.serialization` does not set the padding between aligned values, so that the bytes of a message differ from run to
run. Here the padding is zero.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable
from functools import cache
from struct import Struct
from typing import Any

import numpy as np

_HEADER = b"\x00\x01\x00\x00"
_CODES = {
    "boolean": "?",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float": "f",
    "double": "d",
}
"""Letters for plain types in `struct` and NumPy."""

_COLLECTION = re.compile(r"sequence<(?P<item>[^,]+)(?:, *\d+)?>|(?P<element>.+)\[\d+\]")
_COUNT = Struct("<I")

Append = Callable[[bytearray, Any], None]
"""Appends a value to a message."""


def serialise(message: Any) -> bytes:
    """Return a message as CDR with its four bytes of header. Raises TypeError for a field of wide characters."""
    out = bytearray(_HEADER)
    _append_message(out, message)
    return bytes(out)


def _append_message(out: bytearray, message: Any) -> None:
    for name, append in _fields(message.__class__):
        append(out, getattr(message, name))


@cache
def _fields(kind: Any) -> list[tuple[str, Append]]:
    return [(name, _appender(form)) for name, form in kind.get_fields_and_field_types().items()]


@cache
def _appender(form: str) -> Append:
    """Return a function that appends a field. form: its ROS type, `double`, `sequence<std_msgs/Header>`, `float[9]`."""
    collection = _COLLECTION.fullmatch(form)
    if collection is None:
        return _single(form)
    counted = collection["item"] is not None
    item = (collection["item"] or collection["element"]).strip()
    dtype = np.dtype(f"<{_CODES[item]}") if item in _CODES else None
    append_item = _single(item)

    def append(out: bytearray, values: Any) -> None:
        if counted:
            _align(out, 4)
            out += _COUNT.pack(len(values))
        if dtype is None:
            for value in values:
                append_item(out, value)
        elif len(values):
            _align(out, dtype.itemsize)
            out += memoryview(values).cast("B") if isinstance(values, array) else np.asarray(values, dtype).tobytes()

    return append


def _single(form: str) -> Append:
    if "/" in form:
        return _append_message
    if form.startswith("string"):
        return _append_string
    if form == "octet":
        return lambda out, value: out.extend(value)
    if form not in _CODES:
        raise TypeError(f"a field of type {form} cannot be serialised")
    code = Struct(f"<{_CODES[form]}")

    def append(out: bytearray, value: Any) -> None:
        _align(out, code.size)
        out += code.pack(value)

    return append


def _append_string(out: bytearray, value: str) -> None:
    data = value.encode() + b"\x00"
    _align(out, 4)
    out += _COUNT.pack(len(data))
    out += data


def _align(out: bytearray, size: int) -> None:
    out += bytes((len(_HEADER) - len(out)) % size)
