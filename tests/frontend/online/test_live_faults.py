"""Faults put into a live stream on purpose: what survives is tracked as if nothing had been, the rest is counted."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from esfo_core.camera import SensorSize
from esfo_core.codecs import decoder, encode_mono, encoder
from esfo_core.errors import OptionError
from esfo_core.events import EVENT_DTYPE
from esfo_core.options import replace
from esfo_core.packets import Packet
from esfo_core.tracks import Tracks
from esfo_frontend.frontend import Frontend
from esfo_frontend.online.live_frontend import LiveFrontend
from esfo_frontend.options import PRESETS
from esfo_frontend.warm_up import HEIGHT, WIDTH, drifting_squares

MS = 1_000_000
S = 1_000_000_000
OPTIONS = PRESETS["default"]
HOST = 1_700_000_000 * S
EVENTS = drifting_squares(0.3)
COUNT = len(EVENTS)


def later(t0):
    events = EVENTS.copy()
    events["t"] += t0
    return events


def cut(events, step=4 * MS):
    parts = np.split(events, np.searchsorted(events["t"], np.arange(events["t"][0] + step, events["t"][-1], step)))
    return [part for part in parts if len(part)]


def packet(events, seq, **changes):
    base = int(events["t"].min()) if len(events) else 0
    whole = Packet(seq, WIDTH, HEIGHT, "mono", False, base, encode_mono(events, base), base + HOST, "left")
    return dataclasses.replace(whole, **changes)


def packets(events, first=0, **changes):
    return [packet(part, first + i, **changes) for i, part in enumerate(cut(events))]


def feed(live, stream):
    return [output for p in stream for output in live.process(p)]


def rows(outputs):
    return Tracks.concatenate(o.tracks.observations for o in outputs)


def tracked(events, options=OPTIONS):
    frontend = Frontend(SensorSize(WIDTH, HEIGHT), options)
    return rows([frontend.process(events), frontend.flush()])


def same(a, b):
    return all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in ("track_id", "t", "uv", "sigma"))


def twin(stream):
    """Events (N,) that should come through packets of `mono`, packets skipped, and late events: one by one."""
    taken, newest, last_t, skipped, late = [], -1, -1, 0, 0
    for p in stream:
        if p.seq <= newest:
            skipped += 1
            continue
        newest = p.seq
        for event in decoder("mono", WIDTH, HEIGHT).decode(p.data, p.time_base):
            if event["t"] < last_t:
                late += 1
            else:
                taken.append(event)
                last_t = int(event["t"])
    return np.array(taken, EVENT_DTYPE), skipped, late


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.lists(
        st.tuples(st.integers(0, 12), st.sampled_from(["drop", "twice", "swap", "cut", "empty", "old", "corrupt"])),
        max_size=12,
        unique_by=lambda fault: fault[0],
    )
)
def test_whatever_survives_is_tracked_as_if_it_were_all(faults):
    stream = packets(EVENTS)
    for place, fault in sorted(faults, reverse=True):
        i = 4 * place
        p = stream[i]
        if fault == "drop":
            del stream[i]
        elif fault == "twice":
            stream.insert(i, p)
        elif fault == "swap":
            stream[i], stream[i + 1] = stream[i + 1], p
        elif fault == "cut":
            stream[i] = dataclasses.replace(p, data=bytes(p.data)[: 2 * len(p.data) // 3])
        elif fault == "empty":
            stream[i] = dataclasses.replace(p, data=b"")
        elif fault == "old":
            stream[i] = dataclasses.replace(p, time_base=max(p.time_base - 30 * MS, 0))
        else:
            stream[i] = dataclasses.replace(p, encoding="m\0no")
    expected, skipped, late = twin([p for p in stream if p.encoding == "mono"])
    live = LiveFrontend(OPTIONS)
    outputs = feed(live, stream) + list(live.flush())
    totals = live.totals
    assert (totals.events, totals.late) == (len(expected), late)
    assert totals.unreadable + totals.packets + totals.stale == len(stream)
    assert totals.stale == skipped
    assert totals.restarts == 0
    assert same(rows(outputs), tracked(expected))


def words_of(p, words):
    return dataclasses.replace(p, encoding="evt3", data=np.array(words, "<u2").tobytes())


def test_a_lost_packet_makes_a_stateful_decoder_wait():
    """The row of an event stands in an earlier word, maybe of a packet that was lost."""
    shell = packets(EVENTS)
    live = LiveFrontend(OPTIONS)
    feed(live, [words_of(shell[0], [0x0003, 0x8001, 0x6001, 0x2005])])  # row 3, time, column 5
    assert live.events[["x", "y"]].tolist() == [(5, 3)]
    feed(live, [words_of(shell[2], [0x2006, 0x8001, 0x6002, 0x2007, 0x0008, 0x2009])])
    assert live.events[["x", "y"]].tolist() == [(9, 8)]
    feed(live, [words_of(shell[3], [0x200A])])
    assert live.events[["x", "y"]].tolist() == [(10, 8)]
    feed(live, [dataclasses.replace(words_of(shell[4], [0x0009]), big_endian=True)])
    feed(live, [words_of(shell[5], [0x200B])])
    assert len(live.events) == 0


def test_a_driver_that_begins_again_has_a_clock_that_begins_again():
    """The clock of `evt3` wraps every 16.8 s; a decoder that went on counting would take it for a wrap."""
    base, data = encoder("evt3", round_times=True)(later(40 * S))
    live = LiveFrontend(OPTIONS)
    feed(live, [packet(EVENTS, 5000, encoding="evt3", time_base=base, data=data, stamp=HOST)])
    assert abs(live.offset + base - HOST) < 1000
    base, data = encoder("evt3", round_times=True)(later(S))
    outputs = feed(live, [packet(EVENTS, 0, encoding="evt3", time_base=base, data=data, stamp=HOST + 9 * S)])
    assert (live.totals.restarts, live.totals.late, live.totals.events) == (1, 0, 2 * COUNT)
    assert live.last_t // 1000 == later(S)["t"][-1] // 1000
    assert abs(live.offset + base - HOST - 9 * S) < 1000
    assert len(outputs) == 2


def each_id_once(outputs_of_streams):
    ids = [set(rows(outputs).track_id.tolist()) for outputs in outputs_of_streams]
    return all(ids) and all(max(a) < min(b) for a, b in pairwise(ids))


@pytest.mark.parametrize("length", [1, 2])
def test_a_bag_that_loops_is_one_stream_after_the_other(length):
    """Also a bag shorter than events may be late, as its packets are numbered anew."""
    events = np.concatenate([later(2 * i * S) for i in range(length)])
    stream = packets(events)
    live = LiveFrontend(OPTIONS)
    for p in stream * 3:
        live.arrived(p.seq)
    outputs = feed(live, stream * 3) + list(live.flush())
    totals = live.totals
    assert (totals.events, totals.lost, totals.late, totals.stale, totals.unreadable) == (3 * len(events), 0, 0, 0, 0)
    assert (totals.restarts, totals.renumbered) == (2, 2)
    assert (live.offset, live.health(0).clock_jumps) == (HOST, 0)
    found, once = rows(outputs), tracked(events)
    assert found.uv.tobytes() == 3 * once.uv.tobytes()
    assert len(np.unique(found.track_id)) == 3 * len(np.unique(once.track_id))


def test_time_that_goes_back_without_new_numbers_is_another_stream():
    live = LiveFrontend(OPTIONS)
    first = feed(live, packets(later(9 * S)))
    second = feed(live, packets(later(5 * S), first=75)) + list(live.flush())
    assert (live.totals.restarts, live.totals.renumbered, live.totals.late) == (1, 0, 0)
    assert live.totals.events == 2 * COUNT
    ended = second[0]
    assert ended.tracks.ended.size > 0
    whole = tracked(EVENTS)
    assert len(rows(first)) + len(rows(second)) == 2 * len(whole)
    assert each_id_once([[*first, ended], second[1:]])


def test_time_that_goes_back_inside_of_a_packet_is_another_stream_too():
    border = 5000
    mixed = np.concatenate([later(3 * S)[:border], EVENTS[border:]])
    live = LiveFrontend(OPTIONS)
    outputs = feed(live, [packet(mixed, 0, time_base=0, data=encode_mono(mixed, 0), stamp=HOST + int(mixed["t"][0]))])
    assert (live.totals.restarts, live.totals.late, live.totals.unreadable) == (1, 0, 0)
    assert live.totals.events == COUNT
    assert same(rows([*outputs, *live.flush()][:2]), tracked(later(3 * S)[:border]))
    spent = mixed["t"][border - 1] - mixed["t"][0]
    assert live.offset == HOST + mixed["t"][0] + spent - mixed["t"][border]  # as if the clock had been set back at once


def test_reset_forgets_all_but_the_ids():
    live = LiveFrontend(OPTIONS)
    first = feed(live, packets(later(9 * S), frame_id="right"))
    live.arrived(3)
    live.refuse("damaged")
    live.reset()
    assert live.totals == type(live.totals)()
    assert (live.problem, live.size, live.offset, live.last_t, live.frame_id) == ("", (0, 0), 0, 0, "camera")
    assert list(live.flush()) == []
    live.arrived(900)
    second = feed(live, packets(EVENTS, first=900)) + list(live.flush())
    assert (live.totals.lost, live.totals.restarts, live.totals.events) == (0, 0, COUNT)
    expected = tracked(EVENTS)
    assert rows(second).uv.tobytes() == expected.uv.tobytes()
    assert each_id_once([first, second])


def test_other_options_hold_from_the_next_packet_on():
    other = replace(OPTIONS, {"association.step": 8.0, "association.first_corners": 20})
    stream = packets(EVENTS)
    half = len(stream) // 2
    live = LiveFrontend(OPTIONS)
    first = feed(live, stream[:half])
    live.configure(other)
    second = feed(live, stream[half:]) + list(live.flush())
    n = sum(len(p.data) for p in stream[:half]) // 8
    before, after = tracked(EVENTS[:n]), tracked(EVENTS[n:], other)
    found = rows([*first, *second])
    assert found.uv.tobytes() == np.concatenate([before.uv, after.uv]).tobytes()
    assert each_id_once([[*first, second[0]], second[1:]])
    pieces = [a for o in first + second for a in (o.activity, *o.pyramid) if a is not None]
    assert live.totals.activity_bins == sum(int(a.valid.sum()) for a in pieces)
    pieces = [o.activity for o in first + second if o.activity]
    assert all(b.t0 >= a.end and (b.t0 - a.t0) % a.bin == 0 for a, b in pairwise(pieces))
    assert (live.totals.unreadable, live.totals.events) == (0, COUNT)


def test_other_options_do_not_disturb_a_stateful_decoder():
    encode = encoder("evt3", round_times=True)
    stream = []
    for seq, part in enumerate(cut(EVENTS)):
        base, data = encode(part)
        stream.append(packet(part, seq, encoding="evt3", time_base=base, data=data))
    live = LiveFrontend(OPTIONS)
    feed(live, stream[:30])
    live.configure(PRESETS["paper"])
    feed(live, stream[30:])
    assert live.totals.events == COUNT


def test_impossible_options_are_refused_at_once_and_change_nothing():
    live = LiveFrontend(OPTIONS)
    live.configure(replace(OPTIONS, {"activity.cell": 500}))  # for some sensor it may be right
    live.configure(OPTIONS)
    feed(live, packets(EVENTS)[:30])
    with pytest.raises(OptionError, match=r"activity.cell is 500 px, longer than the sensor of 160x120"):
        live.configure(replace(OPTIONS, {"activity.cell": 500}))
    with pytest.raises(OptionError, match=r"clusters.shared is 100.0 ms, more than half"):
        live.configure(replace(OPTIONS, {"clusters.shared": 100.0}))
    feed(live, packets(EVENTS)[30:])
    assert live.totals.restarts == 0
    assert (live.totals.unreadable, live.totals.events) == (0, COUNT)


def test_options_that_do_not_fit_the_sensor_are_named_packet_by_packet():
    live = LiveFrontend(replace(OPTIONS, {"activity.cell": 500}))
    assert feed(live, packets(EVENTS)[:3]) == []
    assert live.totals.unreadable == 3
    assert "activity.cell is 500 px, longer than the sensor of 160x120" in live.problem
    live.configure(OPTIONS)
    feed(live, packets(EVENTS)[3:])
    assert live.totals.unreadable == 3
    assert live.totals.events > 0


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"encoding": "morse"}, "packet 30: unknown event encoding 'morse'"),
        ({"width": 0}, "packet 30: sensor size 0x120 is not positive"),
        ({"width": 2**31}, "packet 30: sensor size 2147483648x120 is impossible"),
        ({"time_base": 2**63}, "packet 30: time base"),
        ({"big_endian": True}, "packet 30: big-endian"),
    ],
)
def test_one_damaged_packet_does_not_end_the_stream(changes, says):
    stream = packets(EVENTS)
    damaged = [dataclasses.replace(p, **(changes if p.seq == 30 else {})) for p in stream]
    live = LiveFrontend(OPTIONS)
    outputs = feed(live, damaged) + list(live.flush())
    kept = np.concatenate([part for i, part in enumerate(cut(EVENTS)) if i != 30])
    assert says in live.problem
    assert live.totals.unreadable == 1
    assert same(rows(outputs), tracked(kept))


def test_a_packet_of_a_sensor_that_the_options_do_not_fit_does_not_end_the_stream():
    options = replace(OPTIONS, {"activity.cell": 150})
    stream = packets(EVENTS)
    stream[30] = dataclasses.replace(stream[30], width=100, height=100)
    live = LiveFrontend(options)
    outputs = feed(live, stream) + list(live.flush())
    kept = np.concatenate([part for i, part in enumerate(cut(EVENTS)) if i != 30])
    assert "activity.cell is 150 px, longer than the sensor of 100x100" in live.problem
    assert (live.totals.unreadable, live.size) == (1, (WIDTH, HEIGHT))
    assert same(rows(outputs), tracked(kept, options))


def test_ids_go_on_when_the_sensor_size_changes_and_changes_back():
    live = LiveFrontend(OPTIONS)
    streams = [packets(later(0)), packets(later(S), 75, width=200), packets(later(2 * S), 150)]
    outputs = [feed(live, stream) for stream in streams]
    outputs[1], outputs[0] = outputs[1][1:], [*outputs[0], outputs[1][0]]
    outputs[2], outputs[1] = [*outputs[2][1:], *live.flush()], [*outputs[1], outputs[2][0]]
    assert each_id_once(outputs)
    assert live.totals.events == 3 * COUNT
    assert live.size == (WIDTH, HEIGHT)


def test_packets_without_events_are_no_trouble():
    empty = EVENTS[:0]
    live = LiveFrontend(OPTIONS)
    outputs = feed(live, [packet(empty, 0), *packets(EVENTS, 1), packet(empty, 76), packet(empty, 77)])
    assert same(rows([*outputs, *live.flush()]), tracked(EVENTS))
    assert (live.totals.packets, live.totals.unreadable, live.offset) == (len(cut(EVENTS)) + 3, 0, HOST)


def test_the_offset_is_that_of_the_fastest_packets_and_follows_the_clock():
    rng = np.random.default_rng(0)
    stream = packets(EVENTS)
    delays = rng.exponential(2 * MS, len(stream)).astype(int)
    delays[3] = 0
    live = LiveFrontend(OPTIONS)
    for p, delay in zip(stream, delays.tolist(), strict=True):
        feed(live, [dataclasses.replace(p, stamp=p.stamp + delay)])
    assert 0 <= live.offset - HOST <= 0.3 * S / 10_000  # the fastest packet's, aged at 100 ppm for up to 0.3 s
    live.reset()
    feed(live, packets(EVENTS, stamp=0))
    assert live.offset == 0
    assert live.totals.unreadable == 0


@pytest.mark.parametrize("header", ["first", "last", "sent"])
def test_arrays_of_events_have_host_times(header):
    live = LiveFrontend(OPTIONS)
    shifted = later(HOST)
    for part in cut(shifted):
        base, first, last = int(part["t"][0]), int(part["t"][0]), int(part["t"][-1])
        stamp = {"first": first, "last": last, "sent": last + MS}[header]
        feed(live, [packet(part, None, time_base=base, data=encode_mono(part, base), stamp=stamp, host_times=True)])
        assert live.offset == (MS if header == "sent" else 0)
    assert live.totals.events == COUNT


def test_the_frame_is_that_of_the_packets_or_else_the_option():
    live = LiveFrontend(OPTIONS, camera_frame="eye")
    assert live.frame_id == "eye"
    stream = packets(EVENTS)
    feed(live, stream[:1])
    assert live.frame_id == "left"
    feed(live, [dataclasses.replace(stream[1], frame_id="")])
    assert live.frame_id == "eye"


def test_a_pause_in_which_nobody_listened_is_no_loss():
    live = LiveFrontend(OPTIONS)
    for seq in (1, 2, 5):
        live.arrived(seq)
    live.resume()
    live.arrived(500)
    assert live.totals.lost == 2


def test_health_has_a_text_for_each_kind():
    live = LiveFrontend(OPTIONS)
    calm = live.health(0)
    assert calm.problems_since(calm, "") == {}
    busy = dataclasses.replace(calm, **{f.name: 3 for f in dataclasses.fields(calm)})
    texts = busy.problems_since(calm, "packet 7: torn")
    assert set(texts) == {f.name for f in dataclasses.fields(calm)} - {"events"}
    assert all(text.startswith("3 ") for text in texts.values())
    assert "packet 7: torn" in texts["unreadable"]
    assert calm.problems_since(busy, "") == {}  # after a reset
