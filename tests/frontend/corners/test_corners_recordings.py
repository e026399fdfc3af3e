"""eFAST by the far-pair mask decides as the plain twin on every event of every recording at hand."""

from pathlib import Path

import numpy as np
import pytest
from corner_twins import USUAL, efast_twin

from esfo_core.recordings import open_recording
from esfo_frontend.corners.detector import CornerDetector
from esfo_frontend.options import CornerOptions

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
RECORDINGS = [
    "ros_bags/evt3_ros2_db3",
    "ros_bags/evt3_ros1.bag",
    "ros_bags/libcaer_cmp_ros2_mcap",
    "ros_bags/evt3_trigger_ros2_db3",
    "ros_bags/libcaer_rollover_ros2_db3",
    "raw/evt3.raw",
    "raw/gen4.dat",
    "raw/evt2.raw",
    "raw/davis346.aedat4",
    "wheel/wheel_11_34_19.aedat4",
    "wheel/wheel_11_34_58.aedat4",
    "wheel/wheel_11_36_31.aedat4",
    "event_camera_dataset/shapes_rotation/events.txt",
    "event_camera_dataset/poster_rotation/events.txt",
    "event_camera_dataset/boxes_rotation/events.txt",
]


@pytest.mark.parametrize("name", RECORDINGS)
def test_every_decision_is_that_of_the_plain_twin(name):
    if not (DATA / name).exists():
        pytest.skip(f"the recordings of ../shared/data are not here ({name})")
    events = np.concatenate(list(open_recording(DATA / name).chunks()))
    events = events[np.argsort(events["t"], kind="stable")]
    size = int(events["x"].max()) + 1, int(events["y"].max()) + 1
    one, two = (CornerDetector(*size, CornerOptions(threads=threads)) for threads in (1, 2))
    found = one.detect(events)
    columns = (np.ascontiguousarray(events[column]) for column in "xypt")
    assert np.array_equal(found, efast_twin(*columns, size, USUAL))
    assert np.array_equal(found, two.detect(events))
    assert 0 < found.sum() < len(events) / 2
