"""Commands in README and docs exist and take the options that they are given; the cheap ones run."""

import argparse
import ast
import importlib.util
import re
import shlex
from itertools import pairwise
from pathlib import Path

import pytest

from esfo_bringup.cli import main
from esfo_bringup.commands import COMMANDS, add_command
from esfo_bringup.settings import settings_for, share_out
from esfo_core.camera import Camera
from esfo_core.options import fields_of, parse_assignments, replace
from esfo_simulation.handheld.scene import HandheldOptions
from esfo_simulation.scene import SceneOptions

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
PACKAGES = ROOT / "ros2_ws/src"
LAUNCH_FILE = PACKAGES / "esfo_bringup/launch/esfo.launch.py"
OTHERS = {"sudo", "for", "done", "pre-commit", "pip"}
"""Programs that are not of this repository."""
SMALL = ["-p", "width:=96", "-p", "height:=72", "-p", "revolutions:=0.3"]


def blocks(path):
    """Lines of the fenced blocks of a document that are shell commands."""
    found = re.findall(r"^```(\w*)\n(.*?)^```", path.read_text(), re.S | re.M)
    return [line for kind, text in found if kind in ("", "bash", "sh") for line in text.splitlines()]


def commands():
    """Every command as words, with its document; `a && b` are two."""
    for path in DOCUMENTS:
        for line in blocks(path):
            words = shlex.split(line, comments=True)
            while words:
                end = words.index("&&") if "&&" in words else len(words)
                command, words = words[:end], words[end + 1 :]
                while command and re.fullmatch(r"[A-Z_]+=.*", command[0]):
                    command = command[1:]
                if command:
                    yield pytest.param(command, id=f"{path.name}: {' '.join(command)}")


def parser():
    whole = argparse.ArgumentParser(prog="esfo", exit_on_error=False)
    subparsers = whole.add_subparsers(dest="command", required=True)
    for name in COMMANDS:
        add_command(name, subparsers)
    return whole


def check_esfo(words):
    args = parser().parse_args(words)
    values = parse_assignments(getattr(args, "set", []))
    if args.command == "simulate":
        assert args.output is not None
        replace(HandheldOptions() if args.handheld else SceneOptions(), values)
    else:
        share_out(values)
        settings_for("default", values)


def check_make(words):
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.M))
    assert set(words) <= targets | {"mutate"}, words


def check_python(words):
    if words[0] == "-m":
        assert words[1] == "pytest"
        return
    script = ROOT / words[0]
    assert script.is_file(), script
    text = script.read_text()
    missing = [flag for flag in words[1:] if flag.startswith("--") and f'"{flag}"' not in text]
    assert not missing, missing


def launch_arguments():
    """Names of the arguments of the launch file, from its source: it need not be imported."""
    for node in ast.parse(LAUNCH_FILE.read_text()).body:
        if isinstance(node, ast.Assign) and node.targets[0].id == "ARGUMENTS":
            return {ast.literal_eval(key) for key in node.value.keys}
    raise AssertionError("no ARGUMENTS")


def check_ros2(words):
    match words:
        case ["launch", "esfo_bringup", file, *arguments]:
            assert file == LAUNCH_FILE.name
            names = {a.split(":=")[0] for a in arguments if not a.startswith("--")}
            assert names <= launch_arguments(), names
        case ["param", "describe" | "set", node, name, *_]:
            assert node in ("/frontend", "/backend")
            assert name in {leaf.name for leaf in options_of(node)}, name
        case ["service", "call", service, kind, *_]:
            assert service in ("/backend/save", "/backend/solve", "/frontend/flush"), service
            assert kind == "std_srvs/srv/Trigger"
        case ["launch" | "bag" | "lifecycle" | "param", *_]:
            pass
        case _:
            raise AssertionError(words)


def options_of(node):
    settings = settings_for("default", {})
    return fields_of(settings.frontend if node == "/frontend" else settings.backend)


def check_docker(words):
    for flag, name in pairwise(words):
        if flag == "-f":
            assert (ROOT / name).is_file(), name
        if flag == "--profile":
            assert f"profiles: [{name}" in (ROOT / "docker/compose.yaml").read_text(), name
    if "esfo" in words[:-2] and words[0] == "run":
        check_esfo(words[len(words) - words[::-1].index("esfo") :])


CHECKS = {"esfo": check_esfo, "make": check_make, "python": check_python, "ros2": check_ros2, "docker": check_docker}


@pytest.mark.parametrize("command", list(commands()))
def test_every_command_exists_and_takes_its_options(command):
    program, *words = command
    if program in CHECKS:
        CHECKS[program](words)
    elif program == "source":
        assert words[0].startswith("/opt/ros") or (ROOT / words[0]).is_file()
    else:
        assert program in OTHERS, program


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_commands_in_the_text_exist(path):
    text = re.sub(r"^```.*?^```", "", path.read_text(), flags=re.S | re.M)
    helps = {name: sub.format_help() for name, sub in parser()._subparsers._group_actions[0].choices.items()}
    for command in re.findall(r"`((?:esfo|make|python) [^`]+)`", text):
        program, first, *words = command.split()
        if program == "make":
            check_make([first])
        elif program == "python":
            check_python([first, *words])
        else:
            assert first in helps, command
            missing = [w for w in words if w.startswith("--") and w.split("=")[0] not in helps[first]]
            assert not missing, command


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_files_and_modules_in_the_text_exist(path):
    quoted = re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", path.read_text(), flags=re.S | re.M))
    for name in quoted:
        if re.fullmatch(r"(tests|benchmarks|scripts|docker|requirements)/[\w./-]*", name):
            assert (ROOT / name).exists(), name
        if re.fullmatch(r"(esfo_\w+)((\.|/)\w+)+(\.py|/)?", name):
            package, *rest = re.split(r"[./]", name.removesuffix(".py").rstrip("/"))
            if package == "esfo_msgs":
                assert (PACKAGES / package / "msg" / f"{rest[-1]}.msg").is_file(), name
            else:
                exists(PACKAGES / package / package, rest)


def exists(folder, names):
    """Check that names lead to a folder, to a module, or to something that a module defines."""
    for k, name in enumerate(names):
        module = folder / f"{name}.py"
        if module.is_file():
            defined = "".join(names[k + 1 : k + 2])
            assert not defined or re.search(rf"^(def |class |)\b{defined}\b", module.read_text(), re.M), (
                module,
                defined,
            )
            return
        folder = folder / name
        assert folder.is_dir(), folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the files that README's commands name: `scene.mcap` made by its own command, only smaller."""
    folder = tmp_path_factory.mktemp("readme")
    (line,) = [c.values[0] for c in commands() if c.id.startswith("README.md: esfo simulate --object")]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main([*line[1:], *SMALL]) == 0
        (folder / "scene.mcap").rename(folder / "RECORDING.mcap")
        Camera.pinhole(96, 72, 120.0).write_yaml(folder / "camera.yaml")
    return folder


@pytest.mark.parametrize("command", ["info", "run"])
def test_readme_commands_run(command, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    (line,) = [c.values[0] for c in commands() if c.id.startswith(f"README.md: esfo {command} RECORDING")]
    words = ["RECORDING.mcap" if word == "RECORDING" else word for word in line[1:]]
    code = main(words)
    printed = capsys.readouterr()
    if command == "info":
        assert code == 0
        assert "96x72" in printed.out
    else:  # 0.3 revolutions are too few for an estimate, and the command says so
        assert code == 1
        assert "failed" in printed.err
        assert (folder / "out/orbit.json").exists()
        assert (folder / "out/report.html").exists()


def document_module():
    spec = importlib.util.spec_from_file_location("document", ROOT / "benchmarks/document.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_benchmark_has_a_section_and_every_section_a_benchmark():
    document = document_module()
    text = "".join(path.read_text() for path in DOCUMENTS)
    assert set(re.findall(r"^<!-- begin: (\S+) -->$", text, re.M)) == set(document.SECTIONS)
    for name in document.SECTIONS:
        document.replaced(document.document_of(name).read_text(), name, "")
    scripts = {path.name for path in (ROOT / "benchmarks").glob("*.py") if "print_provenance()" in path.read_text()}
    assert {script for script, *_ in document.SECTIONS.values()} == scripts - {"provenance.py"}


def test_only_the_section_is_replaced():
    replaced = document_module().replaced
    text = "before\n<!-- begin: a -->\nold\n<!-- end: a -->\n<!-- begin: b -->\nkept\n<!-- end: b -->\n"
    assert replaced(text, "a", "\\1 new\n\n") == text.replace("old", "\\1 new")
    with pytest.raises(ValueError, match="'c'"):
        replaced(text, "c", "new")


def test_new_names_in_the_changelog_are_those_of_the_code():
    known = {leaf.name for node in ("/frontend", "/backend") for leaf in options_of(node)}
    renamed = re.findall(r"^\| `([\w.]+)` \| `([\w.]+)` \|$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert len(renamed) > 20
    for former, name in renamed:
        assert name in known, name
        assert former not in known, former
