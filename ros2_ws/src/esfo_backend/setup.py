from setuptools import find_packages, setup

PACKAGE = "esfo_backend"

setup(
    name=PACKAGE,
    version="0.1.0",
    description="Back-end of event-based structure from orbit",
    license="Apache-2.0",
    maintainer="ESfO maintainers",
    maintainer_email="esfo-maintainers@users.noreply.github.com",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    zip_safe=False,  # compiled kernels are cached beside their source
    entry_points={"console_scripts": ["backend_node = esfo_backend.ros.node:main"]},
)
