"""The result of a run as a ROS 2 bag, with the messages that a live run publishes."""
