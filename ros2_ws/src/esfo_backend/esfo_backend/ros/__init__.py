"""The ROS node of the back-end and its messages."""
