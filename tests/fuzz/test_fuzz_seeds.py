"""The seeds of the fuzzer, cut and damaged, through every decoder; and the check itself notices what is wrong."""

from __future__ import annotations

import random

import numpy as np
import pytest
from decoder_check import check, seeds

from esfo_core.codecs import ENCODINGS, decoder
from esfo_core.codecs.mono import MonoDecoder


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_seeds_and_their_neighbours(encoding):
    rng = random.Random(3)
    for seed in seeds(encoding):
        check(encoding, seed)
        for _ in range(60):
            damaged = bytearray(seed)
            for _ in range(rng.choice((1, 3, 20))):
                damaged[rng.randrange(len(damaged))] = rng.randrange(256)
            check(encoding, bytes(damaged[: rng.randrange(9, len(damaged) + 1)]))


@pytest.mark.parametrize("encoding", [e for e in ENCODINGS if len(seeds(e)) > 3])
def test_seeds_hold_events(encoding):
    d = decoder(encoding, 346, 260)
    assert len(d.decode(seeds(encoding)[0][9:], 0))


def test_the_check_notices_events_off_the_sensor(monkeypatch):
    monkeypatch.setattr(MonoDecoder, "_inside", lambda self, x, y: np.ones(len(x), bool))
    with pytest.raises(AssertionError):
        check("mono", bytes(9) + b"\xff" * 16)
