"""The pipeline without ROS."""
