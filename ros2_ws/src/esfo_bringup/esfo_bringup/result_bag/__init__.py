"""The result of a run as a ROS 2 bag: what a live run would have published."""
