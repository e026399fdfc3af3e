"""The ROS node of the front-end and its messages."""
