from setuptools import find_packages, setup

PACKAGE = "esfo_ros"

setup(
    name=PACKAGE,
    version="0.1.0",
    description="Shared parts of the ROS nodes of event-based structure from orbit",
    license="Apache-2.0",
    maintainer="ESfO maintainers",
    maintainer_email="esfo-maintainers@users.noreply.github.com",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    zip_safe=True,
)
