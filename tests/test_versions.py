"""One version, wherever it is written."""

import ast
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "ros2_ws" / "src"
PACKAGES = sorted(path.parent for path in SOURCE.glob("*/package.xml"))


def test_all_packages_are_there():
    assert [p.name for p in PACKAGES] == [
        "esfo_backend",
        "esfo_bringup",
        "esfo_core",
        "esfo_frontend",
        "esfo_msgs",
        "esfo_ros",
        "esfo_simulation",
    ]


def test_versions_agree():
    found = {}
    for package in PACKAGES:
        found[package.name, "package.xml"] = ET.parse(package / "package.xml").findtext("version")
        for path in (package / "setup.py", package / package.name / "__init__.py"):
            if path.exists():
                versions = re.findall(r"""(?m)^\s*(?:__version__ = |version=)["'](.+?)["']""", path.read_text())
                assert len(versions) == 1, path
                found[package.name, path.name] = versions[0]
    assert len(found) == 3 * len(PACKAGES) - 2
    found["CITATION.cff"] = yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"]
    assert len(set(found.values())) == 1, found


def test_licences_and_maintainers_agree():
    root = [ET.parse(package / "package.xml").getroot() for package in PACKAGES]
    assert {r.findtext("license") for r in root} == {"Apache-2.0"}
    maintainers = {(r.findtext("maintainer"), r.find("maintainer").get("email")) for r in root}
    assert maintainers == {("ESfO maintainers", "esfo-maintainers@users.noreply.github.com")}
    for package in PACKAGES:
        if (package / "setup.py").exists():
            call = ast.parse((package / "setup.py").read_text()).body[-1].value
            values = {k.arg: k.value.value for k in call.keywords if isinstance(k.value, ast.Constant)}
            assert values["license"] == "Apache-2.0"
            assert {(values["maintainer"], values["maintainer_email"])} == maintainers
