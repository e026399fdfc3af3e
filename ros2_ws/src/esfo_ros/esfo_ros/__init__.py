"""Shared parts of the ROS nodes: life cycle, connections, parameters, diagnostics, worker thread, entry point."""

__version__ = "0.1.0"
