"""Run benchmarks and put their output into the documents, between `<!-- begin: NAME -->` and `<!-- end: NAME -->`."""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

from tqdm import tqdm

FOLDER = Path(__file__).resolve().parent
DOCS = FOLDER.parent / "docs"
DEMO = "demo/scene.mcap"
"""Recording that `make demo` writes."""

SECTIONS: dict[str, tuple[str, ...]] = {
    "pipeline": ("pipeline.py",),
    "result-bag": ("result_bag.py", DEMO),
    "simulation": ("simulation.py",),
    "frontend": ("frontend.py", "--paper-events", "0.1"),
    "live-stream": ("live_stream.py", DEMO),
    "graph": ("graph.py",),
    "detectors": ("detectors.py",),
    "clustering": ("clustering.py", "--with-package"),
    "tracking": ("tracking.py",),
    "backend": ("backend.py",),
    "axis-error": ("axis_error.py",),
    "solver": ("solver.py",),
    "live": ("live.py",),
    "verdicts": ("verdicts.py",),
    "reading": ("reading.py",),
    "reading-large": ("reading.py", "--large", "1.1"),
    "sensor": ("sensor.py",),
    "rendering": ("rendering.py",),
    "realism": ("realism.py",),
}
"""Script and arguments of every section."""


def replaced(text: str, name: str, output: str) -> str:
    """Return a document with new text in the section `name`. Raises ValueError unless it is there once."""
    marked = re.compile(rf"(<!-- begin: {re.escape(name)} -->\n).*?(<!-- end: {re.escape(name)} -->)", re.S)
    result, count = marked.subn(lambda m: f"{m[1]}{output.strip()}\n{m[2]}", text)
    if count != 1:
        raise ValueError(f"{count} sections {name!r}, expected one")
    return result


def document_of(name: str) -> Path:
    """Return the document that has the section `name`. Raises ValueError if none has."""
    for path in sorted(DOCS.glob("*.md")):
        if f"<!-- begin: {name} -->" in path.read_text():
            return path
    raise ValueError(f"no document has a section {name!r}")


def run(name: str) -> str:
    """Run the benchmark of a section and return its output. Raises CalledProcessError if it fails."""
    script, *arguments = SECTIONS[name]
    command = [sys.executable, str(FOLDER / script), *arguments]
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, cwd=FOLDER.parent).stdout


def main() -> None:
    """Update the sections that are asked for, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sections", nargs="*", metavar="NAME", help=f"one or more of {', '.join(SECTIONS)}")
    parser.add_argument("--all", action="store_true", help="all sections, which takes hours")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.sections if name not in SECTIONS]
    if unknown or not (arguments.all or arguments.sections):
        parser.error(f"unknown section {unknown[0]!r}" if unknown else "name a section, or --all")
    for name in tqdm(list(SECTIONS) if arguments.all else arguments.sections, desc="sections", disable=None):
        path = document_of(name)
        output = run(name)
        path.write_text(replaced(path.read_text(), name, output))


if __name__ == "__main__":
    main()
