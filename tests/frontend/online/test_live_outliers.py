"""A lone event at a wrong time inside of a live packet is dropped; the stream goes on as if it had not been."""

from __future__ import annotations

import numpy as np
import pytest

from esfo_core.codecs import encode_mono
from esfo_core.events import make_events
from esfo_core.packets import Packet
from esfo_frontend.online.live_frontend import LiveFrontend
from esfo_frontend.options import PRESETS

MS = 1_000_000


def packets(wrong):
    """Ten packets of 10 ms; the times of `wrong` (packet, event, ns off) are off."""
    for seq in range(10):
        t = 4_000 * MS + seq * 10 * MS + np.arange(100) * MS // 10
        events = make_events(np.arange(100) % 60, np.arange(100) % 40, np.arange(100) % 2, t)
        for number, event, off in wrong:
            if number == seq:
                events["t"][event] += off
        base = int(events["t"].min())
        yield Packet(seq, 64, 48, "mono", False, base, encode_mono(events, base), 0, "camera")


@pytest.mark.parametrize("off", [-998 * MS, -60 * MS, 60 * MS, 3_000 * MS])
def test_outliers_inside_of_packets(off):
    live = LiveFrontend(PRESETS["default"])
    for packet in packets([(3, 50, off), (3, 70, off), (7, 1, off)]):
        list(live.process(packet))
    totals = live.totals
    assert (totals.events, totals.outliers, totals.late, totals.restarts, totals.unreadable) == (997, 3, 0, 0, 0)
    assert (
        "3 events at times" in live.health(0).problems_since(LiveFrontend(PRESETS["default"]).health(0), "")["outliers"]
    )
