from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "esfo_bringup"
SHARED = ("launch", "config", "rviz", "foxglove")

setup(
    name=PACKAGE,
    version="0.1.0",
    description="Launch files, parameters, layouts, the replay node and the esfo command",
    license="Apache-2.0",
    maintainer="ESfO maintainers",
    maintainer_email="esfo-maintainers@users.noreply.github.com",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *((f"share/{PACKAGE}/{folder}", [str(p) for p in Path(folder).iterdir() if p.is_file()]) for folder in SHARED),
    ],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "esfo = esfo_bringup.cli:console",
            "replay_node = esfo_bringup.replay.node:main",
            "camera_info_node = esfo_bringup.camera_info.node:main",
        ]
    },
)
