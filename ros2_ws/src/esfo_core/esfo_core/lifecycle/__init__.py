"""Nodes with the life cycle of ROS 2."""
