"""What becomes of result.mcap when there is no orbit, no ROS, no room, or no wish for it."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from esfo_backend.backend import Backend
from esfo_bringup.cli import main
from esfo_bringup.offline import pipeline as offline
from esfo_bringup.offline.pipeline import run_offline
from esfo_bringup.offline.source import open_source
from esfo_bringup.result_bag import opening
from esfo_bringup.result_bag.recorder import Recorder
from esfo_bringup.result_bag.stream_health import StreamHealth
from esfo_bringup.settings import settings_for
from esfo_core.camera import Camera
from esfo_core.errors import RecordingError
from esfo_core.events import make_events
from esfo_core.recordings import write_mcap
from esfo_core.recordings.bag_writer import BagWriter


@pytest.fixture
def noise(tmp_path):
    """Half a second in which nothing moves: no orbit, and no time lost."""
    rng = np.random.default_rng(0)
    t = 10**9 + np.sort(rng.integers(0, 500_000_000, 4000))
    path = tmp_path / "noise.mcap"
    columns = rng.integers(0, 64, 4000), rng.integers(0, 48, 4000), rng.integers(0, 2, 4000)
    write_mcap(path, [make_events(*columns, t)], Camera.pinhole(64, 48, 80.0))
    return path


def topics_with_messages(path):
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        return {summary.channels[n].topic for n, k in summary.statistics.channel_message_counts.items() if k}


def test_without_an_orbit_there_is_no_motion(noise):
    out = noise.parent / "out"
    assert main(["run", str(noise), "-o", str(out)]) == 1
    topics = topics_with_messages(out / "result.mcap")
    assert not topics & {"/tf", "/points", "/spin_rate"}
    assert topics >= {"/orbit", "/markers", "/events", "/overlay", "/event_activity", "/camera_info"}
    with AnyReader([out / "result.mcap"]) as reader:
        orbits = [reader.deserialize(d, c.msgtype) for c, _, d in reader.messages() if c.topic == "/orbit"]
    assert [o.status for o in orbits] == [2, 2]
    assert orbits[0].reason


def test_a_guessed_camera_is_not_handed_on(noise):
    source = open_source(noise, None)
    guess = SimpleNamespace(recording=source.recording, camera=source.camera, assumed=True)
    out = noise.parent / "out"
    with opening.ResultBag(out, guess, "all", Recorder) as bag:
        bag.finish(run_offline(source, settings_for("default", {}), Backend, bag.add))
    assert "/camera_info" not in topics_with_messages(out / "result.mcap")


def test_events_or_all_can_be_left_out(noise, capsys):
    out = noise.parent / "out"
    main(["run", str(noise), "-o", str(out), "--bag", "no-events"])
    assert "report.html, result.mcap\n" in capsys.readouterr().out
    topics = topics_with_messages(out / "result.mcap")
    assert "/events" not in topics
    assert "/overlay" in topics
    main(["run", str(noise), "-o", str(out), "--bag", "none"])
    assert "result.mcap" not in capsys.readouterr().out
    assert not (out / "result.mcap").exists()
    assert (out / "orbit.json").exists()


def test_without_ros_the_command_says_so_and_does_the_rest(noise, monkeypatch, capsys):
    out = noise.parent / "out"
    main(["run", str(noise), "-o", str(out)])
    assert (out / "result.mcap").exists()
    (out / "orbit.json").unlink()
    monkeypatch.setitem(sys.modules, "esfo_bringup.result_bag.recorder", None)  # importing it raises ImportError
    capsys.readouterr()
    main(["run", str(noise), "-o", str(out)])
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "result.mcap" in line]
    assert line.startswith("not written")
    assert "the ROS messages cannot be loaded" in line
    assert (out / "orbit.json").exists()
    assert not (out / "result.mcap").exists()  # that of the earlier run would pass for this one's


@pytest.mark.parametrize("calls", [3, 200])
def test_a_full_disk_ends_the_bag_not_the_run(noise, monkeypatch, capsys, calls):
    real, count = BagWriter.write, iter(range(10**9))

    def write(self, *arguments):
        if next(count) > calls:
            raise RecordingError(f"{self._path}: No space left on device")
        real(self, *arguments)

    monkeypatch.setattr(BagWriter, "write", write)
    monkeypatch.setattr(opening, "_MOST_WAITING", 2)  # the run must not wait for a bag that takes nothing any more
    out = noise.parent / "out"
    assert main(["run", str(noise), "-o", str(out)]) == 1
    assert "not written" in capsys.readouterr().out
    assert (out / "orbit.json").exists()
    assert not list(out.glob("result.mcap*"))


def test_a_bug_while_writing_is_not_hidden(noise, monkeypatch):
    def write(self, *arguments):
        raise ZeroDivisionError

    monkeypatch.setattr(BagWriter, "write", write)
    with pytest.raises(ZeroDivisionError):
        main(["run", str(noise), "-o", str(noise.parent / "out")])


def test_a_run_that_fails_leaves_no_bag(noise, monkeypatch):
    def fail(self, events):
        raise RecordingError("torn")

    monkeypatch.setattr(offline.Frontend, "process", fail)
    out = noise.parent / "out"
    assert main(["run", str(noise), "-o", str(out)]) == 1
    assert list(out.iterdir()) == []


def test_what_the_reader_lost_is_told_in_the_second_in_which_it_was_lost():
    statistics = SimpleNamespace(packets_lost=0, packets_damaged=0, decoder=SimpleNamespace(out_of_range=0))
    health = StreamHealth(SimpleNamespace(statistics=statistics))
    output = SimpleNamespace(tracks=SimpleNamespace(observations=range(7)))
    reports = []
    for k in range(40):
        statistics.packets_lost += 2 if k in (13, 15) else 0
        statistics.packets_damaged += 1 if k == 15 else 0
        t = 5 * 10**9 + 100_000_000 * k + np.array([0, 90_000_000])
        reports.append(health.add(make_events(*np.zeros((3, 2), int), t), output))
    told = [report for report in reports if report is not None]
    assert [round(report.t / 1e9) for report in told] == [6, 7, 8]
    assert [report.problems for report in told] == [
        {},
        {"packets lost": "4 packets lost", "packets unreadable": "1 packets unreadable"},
        {},
    ]
    assert told[-1].counts["events"] == 2 * told[-1].counts["observations"] / 7
    assert told[-1].counts["packets lost"] == 4
    assert sum(report.counts["Mev/s in"] for report in told) == pytest.approx(told[-1].counts["events"] / 1e6)
