"""Replay of a recording into the ROS graph."""
