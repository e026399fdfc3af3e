"""Shared, ROS-free types of the event-based structure-from-orbit pipeline."""

__version__ = "0.1.0"
