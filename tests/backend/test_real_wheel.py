"""A real wheel that slows down and stops within two turns: the verdict says that its rate falls."""

from pathlib import Path

import pytest

from esfo_backend.backend import Backend
from esfo_bringup.offline.pipeline import run_offline
from esfo_bringup.offline.source import open_source
from esfo_bringup.settings import settings_for

WHEEL = Path(__file__).parents[3] / "shared/data/wheel"
RECORDINGS = ["wheel_11_34_19", "wheel_11_34_58", "wheel_11_36_31"]


@pytest.mark.parametrize("name", RECORDINGS)
def test_the_rate_is_found_to_fall(name):
    path = WHEEL / f"{name}.aedat4"
    if not path.exists():
        pytest.skip(f"{path} is absent")
    estimate = run_offline(open_source(path, None), settings_for("default", {}), Backend).estimate
    assert estimate.status == "failed"  # 100x100 px give a dozen tracks, too few for an axis
    assert "rate_not_constant" in estimate.flags
    begin, end = (float(word) for word in estimate.reason.split("from ")[1].split(" Hz")[0].split(" to "))
    # About 6 to 8 turns per second when the hand lets go, and half to one and a half before it stands.
    assert 4 < begin < 9
    assert end < 0.7 * begin
