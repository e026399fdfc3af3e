"""`import esfo`: the code of README and docs/python.md runs, and gives what `esfo run` gives."""

import contextlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import esfo
from esfo_bringup.cli import main
from esfo_core import __version__

ROOT = Path(__file__).parents[2]


def python_blocks(name):
    blocks = re.findall(r"(?ms)^```python\n(.*?)^```$", (ROOT / name).read_text())
    assert blocks, name
    return blocks


@pytest.fixture(scope="module")
def readme(tmp_path_factory):
    """The example of the README: the folder in which it ran, and its variables."""
    folder = tmp_path_factory.mktemp("readme")
    (code,) = python_blocks("README.md")
    assert len(code.splitlines()) <= 11, "ten lines, and an empty one"
    names = {}
    with contextlib.chdir(folder):
        exec(code, names)
    return folder, names


def test_the_example_of_the_readme_finds_the_truth(readme):
    _, names = readme
    estimate, truth = names["result"].estimate, names["truth"].spin
    assert estimate.status == "ok"
    assert estimate.spin.rate_hz == pytest.approx(truth.rate_hz, rel=1e-3)
    assert np.degrees(np.arccos(estimate.spin.axis @ truth.axis)) < 1.5


def test_it_writes_the_files_that_it_names(readme):
    folder, _ = readme
    assert (folder / "axis.png").read_bytes()[:4] == b"\x89PNG"
    assert {path.name for path in (folder / "out").iterdir()} == {
        "orbit.json", "points.ply", "tracks.csv", "report.html", "axis.png", "checks.png",
    }  # fmt: skip


def test_the_result_is_that_of_the_command(readme, capsys):
    folder, names = readme
    assert main(["run", str(folder / "scene.mcap"), "-o", str(folder / "command"), "--bag", "none"]) == 0
    assert str(names["result"]) in capsys.readouterr().out
    orbits = [json.loads((folder / run / "orbit.json").read_text()) for run in ("out", "command")]
    for orbit in orbits:
        del orbit["timing_s"]
    assert orbits[0] == orbits[1]
    for name in ("points.ply", "tracks.csv", "axis.png", "checks.png"):
        assert (folder / "out" / name).read_bytes() == (folder / "command" / name).read_bytes(), name


def test_the_code_of_the_second_step_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    for code in python_blocks("docs/python.md"):
        exec(code, names)
        for kind in ("estimate", "early"):
            if names.get(kind) is not None:
                assert names[kind].spin.rate_hz == pytest.approx(1.0, rel=5e-3), code
    assert names["uv"].shape == (len(names["result"].estimate.points), 2)
    assert names["frontend"].statistics.corners > 0


def test_settings_reach_both_ends(readme, monkeypatch):
    folder, names = readme
    monkeypatch.chdir(folder)
    changed = esfo.settings("default", {"association.first_corners": 40, "scale.radius_m": 2.0})
    result = esfo.run(names["source"], changed)
    assert len(result.tracks) < len(names["result"].tracks)
    assert result.estimate.scale == "metric"
    again = esfo.estimate(names["tracked"], changed)
    assert again.tracks is names["tracked"].tracks
    assert again.estimate.scale == "metric"


def test_a_name_of_reading_in_the_settings_is_refused():
    with pytest.raises(esfo.EsfoError, match=r"width.*esfo\.open"):
        esfo.settings("default", {"width": 640})


def test_opening_takes_a_camera_or_its_file(readme, tmp_path):
    path, camera = readme[0] / "scene.mcap", esfo.Camera.pinhole(240, 180, 321.0)
    camera.write_yaml(tmp_path / "camera.yaml")
    assert esfo.open(path).camera.focal_px == pytest.approx(300.0)
    assert esfo.open(path, camera).camera is camera
    for name in (tmp_path / "camera.yaml", str(tmp_path / "camera.yaml")):
        assert esfo.open(str(path), name).camera.focal_px == pytest.approx(321.0)
    with pytest.raises(esfo.EsfoError, match="321x180"):
        esfo.open(path, esfo.Camera.pinhole(321, 180, 300.0))


def test_opening_takes_what_a_text_does_not_tell(tmp_path):
    (tmp_path / "events.txt").write_text("0.1 3 4 1\n0.2 5 6 0\n")
    source = esfo.open(tmp_path / "events.txt", width=64, height=48)
    assert (source.camera.width, source.camera.height, source.assumed) == (64, 48, True)
    with pytest.raises(esfo.EsfoError, match="unknown option 'hight'"):
        esfo.open(tmp_path / "events.txt", hight=48)


def test_every_public_name_is_there():
    assert all(hasattr(esfo, name) for name in esfo.__all__)
    assert esfo.__version__ == __version__


def test_importing_leaves_the_backend_of_matplotlib_to_the_user():
    code = "import matplotlib, esfo; print(matplotlib.get_backend(auto_select=False))"
    unset = {name: value for name, value in os.environ.items() if name != "MPLBACKEND"}
    done = subprocess.run([sys.executable, "-c", code], env=unset, capture_output=True, text=True, check=True)
    assert done.stdout == "None\n"
