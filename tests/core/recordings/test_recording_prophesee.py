"""Prophesee RAW and DAT files: their headers, and what may be wrong with them."""

from __future__ import annotations

import numpy as np
import pytest
from recording_bags import everything, expect_error

EVT3_HEADER = b"% evt 3.0\n% format EVT3;height=48;width=64\n% end\n"
EVT3_EVENT = np.array([0x8001, 0x6001, 0x0003, 0x2805], "<u2").tobytes()


@pytest.mark.parametrize(
    ("header_lines", "size"),
    [
        (EVT3_HEADER, (64, 48)),
        (b"% evt 3.0\n% geometry 320x240\n", (320, 240)),
        (b"% Date now\n% evt 3.0\n% plugin_name hal_plugin_imx636_evk4\n", (1280, 720)),
        (b"% format EVT3\n% Width 304\n% Height 240\n", (304, 240)),
    ],
)
def test_raw_headers(tmp_path, header_lines, size):
    path = tmp_path / "scene.raw"
    path.write_bytes(header_lines + EVT3_EVENT)
    recording, chunks = everything(path)
    assert (recording.width, recording.height) == size
    assert [tuple(int(v) for v in row) for row in chunks[0]] == [(5, 3, 1, 4_097_000)]
    path.write_bytes(header_lines + EVT3_EVENT + b"\0")
    assert everything(path)[0].statistics.decoder.trailing_bytes == 1


@pytest.mark.parametrize(
    ("lines", "order"),
    [
        (b"% evt 2.1\n% geometry 64x48\n% end\n", 1),
        (b"% format EVT21;height=48;width=64\n% end\n", 1),
        (b"% format EVT21;endianness=little;height=48;width=64\n% end\n", 1),
        (b"% evt 2.1\n% format EVT21;endianness=legacy;height=48;width=64\n% end\n", -1),
    ],
)
def test_evt21_in_both_orders_of_its_halves(tmp_path, lines, order):
    path = tmp_path / "scene.raw"
    halves = np.array([[0, 0x8 << 28 | 2], [0b1001, 1 << 28 | 5 << 22 | 32 << 11 | 7]], "<u4")
    path.write_bytes(lines + halves[:, ::order].tobytes())
    _, chunks = everything(path)
    assert chunks[0].tolist() == [(32, 7, 1, 133_000), (35, 7, 1, 133_000)]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (EVT3_HEADER, "no events in 0 packets"),
        (EVT3_HEADER + EVT3_EVENT[:6], "no events in 1 packets"),
        (b"% evt 3.0\n", "no event tells the sensor size"),
        (b"% evt 3.0\n% geometry big\n", "'big' x ''"),
        (b"% evt 3.0\n% geometry 0x480\n", "0x480"),
        (b"% evt 4.0\n% geometry 640x480\n", "unknown event encoding 'evt4'"),
        (b"% Date today\n\0\1", "names no event format .it has date"),
        (b"% Date today\n", "text without a line of events"),
        (b"% evt 3.0", "no end"),
        (b"% Version 2\n% Width 64\n% Height 48\n", "ends after its header"),
        (b"% Version 2\n% Width 64\n% Height 48\n\x0e\x08" + bytes(8), "type 0x0e"),
    ],
)
def test_bad_raw_and_dat_files(tmp_path, content, message):
    path = tmp_path / "scene.raw"
    path.write_bytes(content)
    expect_error(path, message)
