"""What the ROS nodes of all packages share."""

__version__ = "0.1.0"
