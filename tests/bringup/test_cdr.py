"""Messages as CDR, against the two other writers and readers of it: rclpy and rosbags."""

from array import array

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from esfo_msgs.msg import CornerClusters, EventActivity, FeatureTracks, OrbitEstimate
from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import Point, TransformStamped, TwistWithCovarianceStamped
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from std_msgs.msg import ColorRGBA, Float64MultiArray, MultiArrayDimension, String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray, MeshFile, UVCoordinate

from esfo_bringup.result_bag.cdr import serialise
from esfo_bringup.result_bag.messages import definition

MESSAGES = (
    CameraInfo,
    CornerClusters,
    DiagnosticArray,
    EventActivity,
    EventPacket,
    FeatureTracks,
    Float64MultiArray,
    Image,
    Marker,
    MarkerArray,
    OrbitEstimate,
    PointCloud2,
    PointField,
    String,
    TFMessage,
    TwistWithCovarianceStamped,
)
KINDS = {
    "boolean": "?",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float": "f4",
    "double": "f8",
}


def plain(kind, rng, count):
    dtype = np.dtype(KINDS[kind])
    if dtype.kind == "f":
        return rng.normal(size=count).astype(dtype)
    return rng.integers(0, 2 if kind == "boolean" else 120, count).astype(dtype)


def value_of(form, old, rng):
    """A random value for a field of which the message has `old` at first."""
    if form.startswith("sequence<"):
        inner, count = form[9:-1], int(rng.integers(0, 4))
        if inner in KINDS:
            values = plain(inner, rng, count)
            return array(old.typecode, values.tobytes()) if isinstance(old, array) else values.tolist()
        kinds = {"string": None, **{f"{k.__module__.split('.')[0]}/{k.__name__}": k for k in INNER}}
        return [value_of(inner, None if kinds[inner] is None else kinds[inner](), rng) for _ in range(count)]
    if form.endswith("]"):
        return plain(form.split("[")[0], rng, int(form.split("[")[1][:-1]))
    if "/" in form:
        return filled(old, rng)
    if form == "string":
        return "".join(rng.choice(list("abcdé"), int(rng.integers(0, 6))))
    return bytes([int(rng.integers(0, 4))]) if form == "octet" else plain(form, rng, 1)[0].item()


def filled(message, rng):
    for name, form in message.get_fields_and_field_types().items():
        setattr(message, name, value_of(form, getattr(message, name), rng))
    return message


INNER = (
    *(ColorRGBA, DiagnosticStatus, KeyValue, Marker, MeshFile, MultiArrayDimension, Point, PointField),
    *(TransformStamped, UVCoordinate),
)
"""Messages that stand in sequences of other messages."""


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
def test_others_read_what_was_written(kind):
    name = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition(name), name))
    rng = np.random.default_rng(3)
    for k in range(40):
        message = filled(kind(), rng) if k else kind()
        data = serialise(message)
        assert deserialize_message(data, kind) == message
        assert bytes(store.serialize_cdr(store.deserialize_cdr(data, name), name)) == data  # with zeros as padding
        # As rclpy, but for what it leaves between the values and behind them.
        assert all(a in (0, b) for a, b in zip(data, serialize_message(message), strict=False))


def test_wide_characters_are_refused():
    class Wide:
        data = ""

        @classmethod
        def get_fields_and_field_types(cls):
            return {"data": "wstring"}

    with pytest.raises(TypeError, match="wstring"):
        serialise(Wide())
