"""The front-end on packets: what is lost, late, unreadable or from another stream is counted, the rest goes on."""

import numpy as np
import pytest

from esfo_core.camera import SensorSize
from esfo_core.codecs import encode_mono
from esfo_core.events import empty_events, make_events
from esfo_core.packets import Packet
from esfo_core.tracks import Tracks
from esfo_frontend.frontend import Frontend
from esfo_frontend.online.live_frontend import LiveFrontend
from esfo_frontend.options import PRESETS
from esfo_frontend.warm_up import HEIGHT, WIDTH, drifting_squares, warm_up

MS = 1_000_000
SIZE = (WIDTH, HEIGHT)
COUNT = len(drifting_squares(0.3))
STAMP_OFFSET = 7_000_000_000


def scene(t0=0):
    events = drifting_squares(0.3)
    events["t"] += t0
    return events


def packets(events, seq=0, **changes):
    borders = np.searchsorted(events["t"], np.arange(events["t"][0], events["t"][-1], 2 * MS)[1:])
    parts = [part for part in np.split(events, borders) if len(part)]
    for i, part in enumerate(parts):
        base = int(part["t"][0])
        values = {
            "seq": seq + i,
            "width": SIZE[0],
            "height": SIZE[1],
            "encoding": "mono",
            "big_endian": False,
            "time_base": base,
            "data": encode_mono(part, base),
            "stamp": base + STAMP_OFFSET,
            "frame_id": "camera",
        }
        yield Packet(**{**values, **changes})


def feed(live, stream):
    return [output for packet in stream for output in live.process(packet)]


def rows(outputs):
    return Tracks.concatenate(o.tracks.observations for o in outputs)


@pytest.fixture
def live():
    return LiveFrontend(PRESETS["default"])


def test_packets_give_what_the_events_give(live):
    events = scene()
    outputs = feed(live, packets(events)) + list(live.flush())
    frontend = Frontend(SensorSize(*SIZE), PRESETS["default"])
    expected = rows([frontend.process(events), frontend.flush()])
    assert len(expected) > 20
    assert rows(outputs).uv.tobytes() == expected.uv.tobytes()
    totals = live.totals
    assert (totals.events, totals.observations, totals.packets) == (COUNT, len(expected), len(list(packets(events))))
    pieces = [o.activity for o in outputs if o.activity is not None]
    pyramid = [a for o in outputs for a in o.pyramid]
    assert totals.activity_bins == sum(int(a.valid.sum()) for a in (*pieces, *pyramid))
    assert sum(a.counts.sum() for a in pieces) == COUNT
    assert (totals.lost, totals.unreadable, totals.late) == (0, 0, 0)
    assert totals.alive == set()
    assert live.offset == STAMP_OFFSET
    assert live.size == SIZE


def test_lost_packets_are_counted_on_arrival(live):
    for seq in (5, 6, 10, 11, 3, 4):  # three are missing; then the driver was started again
        live.arrived(seq)
    assert live.totals.lost == 3


def test_late_events_are_dropped_and_counted(live):
    events = scene()
    first, last = events[: COUNT // 2], events[COUNT // 2 :]
    late = make_events([1, 2, 3], [1, 2, 3], [0, 1, 0], first["t"][-1] - np.array([900_000, 800_000, 0]))
    outputs = feed(live, packets(first)) + feed(live, packets(late, seq=1000)) + feed(live, packets(last, seq=2000))
    assert live.totals.late == 2
    assert live.totals.events == COUNT + 1
    assert live.totals.unreadable == 0
    assert sum(o.activity.counts.sum() for o in [*outputs, *live.flush()] if o.activity) == COUNT + 1


def test_time_that_goes_back_far_begins_a_new_stream(live):
    late_events, early_events = scene(t0=5_000 * MS), scene(t0=0)
    outputs = feed(live, packets(late_events)) + feed(live, packets(early_events)) + list(live.flush())
    assert live.totals.events == 2 * COUNT
    assert (live.totals.late, live.totals.unreadable) == (0, 0)
    times = np.concatenate([o.tracks.observations.t for o in outputs])
    assert (times >= 5_000 * MS).any()
    assert (times < 1_000 * MS).any()


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"encoding": "morse"}, "unknown event encoding 'morse'"),
        ({"width": 0}, "sensor size 0x120 is not positive"),
        ({"big_endian": True}, "big-endian"),
        ({"time_base": 2**63}, "time base"),
    ],
)
def test_unreadable_packets_are_counted_and_named(live, changes, says):
    bad = list(packets(scene(), **changes))
    assert feed(live, bad) == []
    assert live.totals.unreadable == len(bad)
    assert says in live.problem
    good = list(packets(scene(), seq=len(bad)))
    feed(live, good)
    assert live.totals.events == COUNT


def test_another_sensor_size_ends_the_stream_and_begins_one(live):
    feed(live, packets(scene()))
    outputs = feed(live, packets(scene(t0=1_000 * MS), width=200))
    assert outputs[0].tracks.ended.size > 0
    assert live.size == (200, HEIGHT)
    assert live.totals.events == 2 * COUNT


def test_health_names_what_happened_since(live):
    before = live.health(dropped=0)
    assert before.problems_since(before, "") == {}
    live.arrived(1)
    live.arrived(4)
    feed(live, packets(scene(), encoding="morse"))
    text = "; ".join(live.health(dropped=5).problems_since(before, live.problem).values())
    assert "5 packets dropped" in text
    assert "2 packets lost" in text
    assert "morse" in text
    assert "late" not in text


def test_an_empty_flush_gives_nothing(live):
    assert list(live.flush()) == []
    assert live.events.tobytes() == empty_events().tobytes()


@pytest.mark.parametrize("preset", PRESETS)
def test_the_warm_up_scene_reaches_every_stage(preset):
    frontend = Frontend(SensorSize(*SIZE), PRESETS[preset])
    frontend.process(drifting_squares(0.3))
    frontend.flush()
    counts = frontend.statistics
    assert min(counts.corners, counts.kept, counts.clustered, counts.tracks, counts.rows) > 0
    warm_up(PRESETS[preset])


def test_image_speed_is_that_of_the_squares():
    live = LiveFrontend(PRESETS["default"])
    assert live.image_speed == 0
    for packet in packets(scene()):
        list(live.process(packet))
    assert live.image_speed == pytest.approx(np.hypot(150, 90), rel=0.1)
