"""Replays a recording into the ROS graph."""
