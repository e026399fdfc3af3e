"""Named sensors: what their papers print, and that they can be simulated."""

import numpy as np
import pytest

from esfo_core.errors import SimulationError
from esfo_core.options import check
from esfo_simulation.render.renderer import Levels
from esfo_simulation.sensor.catalogue import SENSORS, sensor_model
from esfo_simulation.sensor.event_sensor import Sensor

# Width, height, width of the array in mm, most events per us.
PRINTED = {
    "davis240c": (240, 180, 4.44, 12),
    "davis346": (346, 260, 6.4, 12),
    "gen3": (640, 480, 9.6, 66),
    "gen4": (1280, 720, 6.22, 1066),
}


@pytest.mark.parametrize("name", SENSORS)
def test_each_is_as_printed_and_makes_events(name):
    model = sensor_model(name)
    width, height, array_mm, mevs = PRINTED[name]
    check(model.options)
    assert (model.width, model.height) == (width, height)
    assert model.width * model.pitch_um / 1000 == pytest.approx(array_mm, rel=0.005)
    assert model.options.readout_mevs == mevs
    # A lens as long as the array is wide sees 2 atan(1/2) of it.
    assert model.focal_px(array_mm) == pytest.approx(width, rel=0.005)
    frames = [np.full((40, 50), level, np.uint16) for level in (20000, 40000)]
    size = (model.width, model.height)
    sensor = Sensor(frames[0], Levels(-3.0, 5e-5), size, (3, 4), model.options, np.random.default_rng(0))
    events = np.concatenate([sensor.step(frames[k % 2], (k * 1e6, (k + 1) * 1e6)) for k in range(20)])
    assert len(events) > 2000 * 3
    assert (np.diff(events["t"]) >= 0).all()


def test_an_unknown_name_is_refused():
    with pytest.raises(SimulationError, match="gen5"):
        sensor_model("gen5")
