"""Messages of events as rclpy serialises them are read as they are meant; the definitions here are the public ones."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("event_camera_msgs.msg", reason="the messages are not built: make setup")
pytest.importorskip("dvs_msgs.msg", reason="the messages are not built: make setup")
pytest.importorskip("prophesee_event_msgs.msg", reason="the messages are not built: make setup")

import dvs_msgs.msg as dvs
import prophesee_event_msgs.msg as prophesee
from builtin_interfaces.msg import Time
from event_camera_msgs.msg import EventPacket
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

from esfo_core.codecs import decoder
from esfo_core.events import make_events
from esfo_core.packets import EVENT_PACKET, packet_from_cdr, sequence_of
from esfo_core.recordings.event_messages import check_definition

INTERFACES = Path(__file__).parents[2] / "ros2_ws" / "interfaces"
HEADER = Header(stamp=Time(sec=1_700_000_000, nanosec=7), frame_id="left/camera")
STAMP = 1_700_000_000_000_000_007


def some_events(count):
    rng = np.random.default_rng(count)
    t = STAMP + np.sort(rng.integers(0, 30_000_000, count))
    return make_events(rng.integers(0, 346, count), rng.integers(0, 260, count), rng.integers(0, 2, count), t)


@pytest.mark.parametrize("package", [dvs, prophesee])
@pytest.mark.parametrize("count", [0, 1, 2, 300])
def test_arrays_of_events(package, count):
    events = some_events(count)
    rows = [
        package.Event(x=x, y=y, ts=Time(sec=t // 10**9, nanosec=t % 10**9), polarity=bool(p))
        for x, y, p, t in events.tolist()
    ]
    data = serialize_message(package.EventArray(header=HEADER, width=346, height=260, events=rows))
    kind = f"{package.__name__.partition('.')[0]}/msg/EventArray"
    packet = packet_from_cdr(kind, data)
    assert (packet.width, packet.height, packet.stamp, packet.frame_id) == (346, 260, STAMP, "left/camera")
    assert (decoder(packet.encoding, 346, 260).decode(packet.data) == events).all()
    assert sequence_of(kind, data) is None


def test_packets():
    fields = {"width": 346, "height": 260, "seq": 2**64 - 1, "time_base": 5, "encoding": "evt3", "is_bigendian": True}
    data = serialize_message(EventPacket(header=HEADER, **fields, events=[1, 2, 255]))
    packet = packet_from_cdr(EVENT_PACKET, data)
    assert (packet.seq, packet.time_base, packet.encoding, packet.big_endian) == (2**64 - 1, 5, "evt3", True)
    assert (packet.stamp, packet.frame_id, bytes(packet.data)) == (STAMP, "left/camera", b"\x01\x02\xff")
    assert sequence_of(EVENT_PACKET, data) == 2**64 - 1


@pytest.mark.parametrize("package", ["dvs_msgs", "prophesee_event_msgs"])
def test_definitions_are_those_that_the_reader_has(package):
    array, event = ((INTERFACES / package / "msg" / f"{name}.msg").read_text() for name in ("EventArray", "Event"))
    text = f"{array}\n{'=' * 80}\nMSG: {package}/Event\n{event}"
    check_definition(f"{package}/msg/EventArray", text)
