"""Types and files of the event-based structure-from-orbit pipeline, without ROS."""

__version__ = "0.1.0"
